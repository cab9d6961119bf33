"""Skills that do what they should not, and modules that cannot be imported, among one that is as it should be."""
