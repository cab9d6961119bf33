"""Scenarios, rewards, studies, samplers and reports, without ROS."""
