"""Teaching of poses and paths by hand."""
