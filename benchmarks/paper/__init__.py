"""The HUSKY paper's tables and figures, made from run folders and shipped weights."""
