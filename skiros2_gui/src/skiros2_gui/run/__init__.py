"""The trees of tasks, live and recorded."""
