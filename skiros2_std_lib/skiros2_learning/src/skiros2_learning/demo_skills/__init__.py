"""Skills whose parameters are learned."""
