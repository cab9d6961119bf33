"""The skill manager's node and its clients."""
