"""Tasks, and the threads that tick them."""
