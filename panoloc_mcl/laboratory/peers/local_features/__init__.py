"""Peers of today that live on local features: points triangulated from the references and P3P, and bags of words."""
