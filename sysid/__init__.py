"""Find out why a MuJoCo joint does not behave like the real one, and mend it."""
