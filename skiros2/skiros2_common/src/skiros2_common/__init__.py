"""What all packages share."""

#: Of all packages.
__version__ = "2.0.0"
