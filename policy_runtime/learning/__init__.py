"""PPO with AMP, its run folder and its curves."""
