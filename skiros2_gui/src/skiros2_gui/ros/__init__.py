"""The window's connection to the nodes of a running system."""
