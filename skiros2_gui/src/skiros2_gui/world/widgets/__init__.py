"""The widgets of the tab "World model"."""
