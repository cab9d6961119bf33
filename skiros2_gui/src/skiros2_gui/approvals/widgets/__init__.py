"""The dialog of approvals, and its button."""
