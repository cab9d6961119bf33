"""Checks skill libraries without running them."""
