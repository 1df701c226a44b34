"""Maps of so many places that not all are asked about an image: a few are retrieved, and these are voted on."""
