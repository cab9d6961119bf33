"""The connection to the running system over ROS."""
