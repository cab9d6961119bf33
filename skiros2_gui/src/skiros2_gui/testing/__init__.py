"""What the window is tested with: jobs that run at once, and a system in this process."""
