"""What tests share: programs run as child processes, and a ROS master with nodes on it."""
