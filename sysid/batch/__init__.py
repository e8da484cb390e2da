"""Many logs and many boards at once."""
