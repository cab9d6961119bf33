"""Learning of skill parameters in simulation. See docs/learning.md."""
