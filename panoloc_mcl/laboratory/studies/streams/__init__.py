"""What comes to a localizer, and how: recordings in other layouts, threads that race."""
