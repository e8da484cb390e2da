"""The report of a board as one HTML page."""
