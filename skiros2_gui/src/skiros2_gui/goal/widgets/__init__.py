"""The goal line and the view of its plan."""
