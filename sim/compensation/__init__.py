"""Compensation of the simulator's time step, so that a simulated decay equals the measured one."""
