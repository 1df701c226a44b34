"""What the filter does when all goes well, and when it does not."""
