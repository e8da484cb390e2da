"""MuJoCo models of a board."""
