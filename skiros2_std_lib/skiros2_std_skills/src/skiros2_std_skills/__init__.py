"""Skills for every library: waiting, edits of the world model, clients of actions and services, planning."""
