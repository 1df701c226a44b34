"""References that do not come as they are: from a drive, from a map, or fewer of them."""
