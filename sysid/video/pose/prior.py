"""A rigid body as it is known before a film is looked at: a square, a plane, or points anywhere."""

from dataclasses import dataclass

import numpy as np

ATTITUDE_STEP = np.radians(1.0)
"""Turns this far apart are different attitudes [rad]: the outermost pixels of a body are a pixel or two apart."""
POINT_FLOOR = 0.02
"""Least standard deviation of a point's position [px]: pixels and lens have faults of their own."""
BODY_FLOOR = 0.04
"""Standard deviation of the error that all points of a body or an edge share [px], by compression while it is held. With it the 95 % intervals of k and d hold the truth in 68 rendered films."""
PLANE_CENTRES = 0.0005
"""Standard deviation of the circles' centres of points in one plane across the axis [focal lengths]: depths differ by 1 %,
a twentieth of it aside."""
SLOPE = 2.0
"""Standard deviation of how depth grows with height [1]: an upturned tail from below and the deck's upper side are 27 degrees to the axis."""
ROUNDS = 3
"""Rounds of least squares in which weights or pixels are found anew: each removes nine tenths of the error, which begins below a pixel."""
SAME_PICTURE = 0.25
"""Motion up to which a picture is still the same one, with the same errors [px]."""


@dataclass(frozen=True, slots=True)
class BodyPrior:
    """Prior knowledge of a body."""

    square: bool = False
    """Its points are the corners of a square that stands across the axis (to within 7 degrees), in order."""
    floor: float = POINT_FLOOR
    """Least standard deviation of a point's position [px]."""
    dead_zone: float = 0.0
    """Motion that compression may leave out of the film, to either side [px]: the less contrast, the more."""
    still: float = SAME_PICTURE
    """Motion up to which its points keep their errors [px]."""
    any_side: bool = False
    """Whether they lie on any side of the deck, which may be slanted, rather than across the axis."""
