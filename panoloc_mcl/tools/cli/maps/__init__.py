"""Commands that build maps, update them and export them."""
