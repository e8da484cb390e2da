"""One kind of sensor a module: columns to roll."""
