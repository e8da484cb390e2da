"""The robot and its canonical poses."""
