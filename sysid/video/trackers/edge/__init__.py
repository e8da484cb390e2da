"""The edge of a bare deck."""
