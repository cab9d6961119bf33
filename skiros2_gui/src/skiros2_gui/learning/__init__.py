"""The tab "Learning"."""
