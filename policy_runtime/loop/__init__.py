"""A policy in closed loop with a robot or a simulation."""
