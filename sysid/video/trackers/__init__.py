"""What can be followed on a deck, one a module."""
