"""The window as a whole: events, jobs, problems, the connection to the running system."""
