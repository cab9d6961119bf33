"""Explains tasks and nodes to people."""
