"""What agents ask for, and how persons answer."""
