"""MuJoCo models made from a board record, and the skating task."""
