"""The pick-and-place demo: starts a system, gives it a goal, shows what happens, and proves the end from the bag."""
