"""The scene: its tree, the selected element, undo_stack with undo and redo, queries."""
