"""What a sensor adds to a measured motion."""
