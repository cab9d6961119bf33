"""Skills whose runs are recorded: an action of a driver, and children side by side."""
