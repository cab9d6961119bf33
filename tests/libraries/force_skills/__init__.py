"""A skill that presses with an arm, within a force limit."""
