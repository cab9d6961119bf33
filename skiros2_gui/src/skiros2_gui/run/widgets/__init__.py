"""The widgets of the tab "Running"."""
