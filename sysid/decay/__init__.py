"""The linear decay: fit, peaks, numbers, and a test of the linear law."""
