"""The skating cycle in time: pure functions."""
