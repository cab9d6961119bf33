"""The nodes of behaviour trees."""
