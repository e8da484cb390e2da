"""One kind of file a module: bytes to named columns."""
