"""Behaviour trees of skills, and the manager that runs them on one robot."""
