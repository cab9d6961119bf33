"""A skill library: a robot drives to objects and inspects them."""
