"""The linear decay: its fit, its peaks, its numbers, and what does not fit it."""
