"""Least squares of a joint to measured releases."""
