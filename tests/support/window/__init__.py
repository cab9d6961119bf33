"""A window for tests: without ROS, operated by mouse and keys, on a screenshot."""
