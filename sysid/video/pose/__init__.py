"""Points in pictures to the angle of a body."""
