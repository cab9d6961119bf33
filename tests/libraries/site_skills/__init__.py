"""Skills of a building site: a robot drives, paints walls, and opens doors by their handles."""
