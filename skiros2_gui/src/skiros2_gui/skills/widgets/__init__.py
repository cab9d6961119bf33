"""The widgets of the tab "Skills"."""
