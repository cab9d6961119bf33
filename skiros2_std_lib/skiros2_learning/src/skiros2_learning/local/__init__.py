"""Skills, drivers and physics in one process, without a ROS master."""
