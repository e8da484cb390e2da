"""What must be written so that a simulated decay equals the measured one."""
