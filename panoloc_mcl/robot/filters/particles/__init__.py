"""What the Monte Carlo filter is made of: particles, their weights, where they come from and where they gather."""
