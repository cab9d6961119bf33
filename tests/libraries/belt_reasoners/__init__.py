"""Reasoners of a packing line, as a library for SkiROS2 has them."""
