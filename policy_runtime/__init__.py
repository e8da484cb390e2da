"""Training, measuring and running policies."""
