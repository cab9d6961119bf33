"""Elements, parameters, conditions and skill descriptions. No ROS here."""
