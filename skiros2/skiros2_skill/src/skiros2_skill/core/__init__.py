"""Behaviour trees of skills: nodes, processors, engine, tasks and library, without ROS."""
