"""Colours and their meaning, the same in every picture, page and recording."""

REAL = "#E69F00"
"""Measured: orange."""
SIM = "#0072B2"
"""Simulated: blue. The pair stays apart for all common kinds of colour blindness (Okabe and Ito)."""
STOOD = "#8C6BB1"
"""The record as it stood: purple."""
HELD_OUT = "#CC79A7"
"""Judged on releases that were not fitted: pink."""
NOISE = "#999999"
"""The noise floor: grey."""
GOOD = "#009E73"
BAD = "#D55E00"
SERIES = (SIM, "#56B4E9", GOOD, HELD_OUT, "#F0E442", BAD, REAL, "#000000")
"""Several things of one kind beside each other, as policies: Okabe and Ito's."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue (0 to 255) of '#RRGGBB'."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
