"""The scene: its tree, the selected element, edits with undo and redo, queries."""
