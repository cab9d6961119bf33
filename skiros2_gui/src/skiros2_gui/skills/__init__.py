"""The skills that the robots offer, starting them, and the list of tasks."""
