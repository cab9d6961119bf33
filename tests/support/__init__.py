"""Shared test code: child processes, and a ROS master with nodes."""
