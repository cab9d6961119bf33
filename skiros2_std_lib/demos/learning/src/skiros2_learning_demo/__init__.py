"""The demos of learning: a push, and the search of a bore."""
