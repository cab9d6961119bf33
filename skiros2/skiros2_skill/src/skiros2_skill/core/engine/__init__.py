"""Starts, ticks and ends nodes."""
