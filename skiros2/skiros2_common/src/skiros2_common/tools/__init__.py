"""Small tools without ROS."""
