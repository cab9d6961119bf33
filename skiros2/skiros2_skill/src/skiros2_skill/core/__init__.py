"""Behaviour trees of skills: nodes, processors, the tick, parameters, inference. No ROS here."""
