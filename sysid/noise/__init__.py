"""Sensor noise."""
