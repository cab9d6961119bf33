"""Publishes the markers and follows the interactive marker."""
