"""The skateboarding world: robot, task, rewards and observations of the HUSKY paper."""
