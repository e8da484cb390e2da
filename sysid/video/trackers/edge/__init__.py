"""The straight edges of a bare deck's end."""

from functools import partial

from sysid.video.film.reel import Reel
from sysid.video.trackers._base import Target, Tracker, level_angle
from sysid.video.trackers._edge_profile import PIECES
from sysid.video.trackers.edge.far_end import axis_vanishes_at
from sysid.video.trackers.edge.find import find_deck_end
from sysid.video.trackers.edge.follower import EdgeFollower
from sysid.video.trackers.edge.turn import fit_direction


def _find(reel: Reel) -> Target | None:
    look = reel.look
    end = find_deck_end(look)
    if end is None:
        return None
    count = len(end.ends)
    lengths = ", ".join(f"{right - left:.0f}" for left, right in end.ends[..., 0])
    vanishing = axis_vanishes_at(end, float(reel.lens.matrix[0, 0]))
    warnings: tuple[str, ...] = ()
    if reel.options.camera_angle is None and vanishing is None:
        warnings = (
            "an edge does not show from where the camera looks: it is taken to look along the board's axis "
            "to within 5 degrees (say otherwise with --camera-angle)",
        )
    follower = EdgeFollower(end, look.frames[0].box)
    return Target(
        follower=follower,
        what="the deck's edge",
        why=f"{count} straight edge{'s' if count > 1 else ''} ({lengths} px long)",
        solve=partial(fit_direction, pivot=end.pivot, doubts=follower.doubt, vanishing=vanishing),
        zero=partial(level_angle, direction=1 + 0j, symmetry=2),
        zero_note="where the edge is level in the picture",
        joined=tuple((point, point + 1) for point in range(PIECES * count) if (point + 1) % PIECES),
        direction_from="" if vanishing is None else "how the deck's far end turns",
        shows_body=False,
        warnings=warnings,
    )


TRACKER = Tracker(
    rank=3,
    last_resort=True,
    find=_find,
    not_found="no straight edge that moves is seen{where}. Give its region with --roi LEFT TOP WIDTH HEIGHT",
)
