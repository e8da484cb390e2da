"""Comparison of the current model with measurements."""
