"""The scene: board, ground, contacts."""
