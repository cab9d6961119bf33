"""The page "Teach" of the tab "World model"."""
