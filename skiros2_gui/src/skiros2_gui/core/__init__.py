"""What the window holds and does, without Qt and without ROS."""
