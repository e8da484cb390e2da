"""Columns of numbers: names, units, clock."""
