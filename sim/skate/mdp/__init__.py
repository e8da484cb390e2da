"""Commands, observations, rewards, terminations and randomisation of the task."""
