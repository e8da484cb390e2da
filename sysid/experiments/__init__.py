"""Measurements of a board besides its free decay: static tilt, roll-out, added loads."""
