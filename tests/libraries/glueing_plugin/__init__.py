"""A package of somebody else that extends the platform at each of its extension points."""
