"""Joints that something drives: their law fitted to motion and input, missing effects, the next motion."""
