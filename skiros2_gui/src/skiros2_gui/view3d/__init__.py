"""The elements of the scene as markers for rviz."""
