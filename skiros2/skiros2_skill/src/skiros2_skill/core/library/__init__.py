"""Loads skill libraries."""
