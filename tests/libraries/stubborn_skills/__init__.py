"""Skills that do not end at once, and some that cannot be loaded, as libraries of the field have them."""
