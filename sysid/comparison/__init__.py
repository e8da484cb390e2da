"""The model as it stands against measurements."""
