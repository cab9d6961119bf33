"""The Python client of skill managers, used by the window, the command line, the task manager and tests."""
