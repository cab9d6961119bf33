"""The demo of the piston cell: one goal, two arms, a tight fit."""
