"""The tab "3D", which shows rviz."""
