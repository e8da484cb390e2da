"""One joint of any MuJoCo model: as a record, as the scene that releases it, and as a patched file."""
