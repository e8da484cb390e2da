"""Measurements of a board beside its free decay: tipped, rolling out, loaded."""
