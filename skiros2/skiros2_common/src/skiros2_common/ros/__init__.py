"""Shared code of ROS nodes: wire formats, logging, start-up and shutdown."""
