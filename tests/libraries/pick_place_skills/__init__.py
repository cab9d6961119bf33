"""Skills of a mobile robot as libraries in the field write them: no device moves, the world model does."""
