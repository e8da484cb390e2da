"""Frames and the camera that took them."""
