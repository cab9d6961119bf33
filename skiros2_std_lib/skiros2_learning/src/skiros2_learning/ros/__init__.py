"""The real system: a learned configuration in production."""
