"""Departures of a scene from the record: the failure, its causes and warnings, each with the number, the wanted one and the next step."""

from collections.abc import Iterator

from sim.board.bodies import as_represented, substituted
from sim.check.rules import Case
from sim.check.variants import variants
from sim.compensation.parasitics import DECK, Parasitics, TiltJoint
from sysid.board import Board
from sysid.errors import SysidError
from sysid.joint import JointLaw
from sysid.text import display

MIN_DEPARTURE = 0.03
"""Departure from the wanted number that is named as a cause [1]. On the shipped boards 3 % of stiffness, damping or inertia alone
is an NRMSE of 0.9 to 1.4 %, within the gate's 2 %."""


def failures(case: Case) -> Iterator[str]:
    """Yield the failure, if the decays are further apart than is accepted."""
    decays = case.decays
    if decays.nrmse > decays.tolerance:
        yield (
            f"the scene does not decay like {case.kind} '{case.board.name}': NRMSE {100 * decays.nrmse:.1f} %, tolerance "
            f"{100 * decays.tolerance:g} %"
        )


def causes(case: Case) -> Iterator[str]:
    """Yield the causes of a failure."""
    if case.decays.only_rest_is_off:
        show = display(is_rate=False, slides=case.board.slides)
        yield (
            f"the measured rest is {show(case.decays.rest_error, 2)} from the scene's (fit the record to these logs, or "
            "level the sensor)"
        )
        return
    yield from _unwritten(case)
    if case.parts is None:
        yield from variants(case.board, case.scene, case.decays)
    else:
        yield from _departures_of_board(case.board, case.parts)


def warnings(case: Case) -> Iterator[str]:
    """Yield the warnings of a pass."""
    yield from _unwritten(case)
    if case.decays.hidden > case.decays.tolerance:
        yield "the logs are too noisy for this tolerance: record longer, more often, or with a better sensor"


def _unwritten(case: Case) -> Iterator[str]:
    """Yield effects of the record that MuJoCo cannot represent."""
    yield from substituted(case.board)
    lacking = as_represented(case.board)
    if lacking != case.board:
        from sysid.comparison.compare import compare

        releases = [one.release for one in case.decays.releases]
        try:
            share = compare(releases, case.board, law=JointLaw.from_board(lacking)).excess
        except SysidError:  # an extremely stiff stop
            yield "the record's law without it, in continuous time, moves without bound from these logs' releases"
        else:
            yield f"the record's law without it, in continuous time, is {100 * share:.1f} % off these logs itself"


def _departures_of_board(board: Board, parts: Parasitics) -> Iterator[str]:
    """Yield departures of the tilt joint, the mass and the trucks' limits from the record."""
    ratio, wanted = parts.whole.damping_ratio, parts.wanted.damping_ratio
    if ratio >= 1 > wanted:
        yield f"the deck does not swing: its damping ratio is {ratio:.2f}, expected {wanted:.2f}"
    yield from departures(parts)
    expected = board.mass["deck"].value + 2 * board.mass["truck"].value + 4 * board.mass["wheel"].value
    if abs(parts.mass / expected - 1) > MIN_DEPARTURE:
        yield f"the board of the scene weighs {parts.mass:.3g} kg, the record says {expected:.3g} kg"
    own = board.tilt["range"].value
    if parts.reach < (1 - MIN_DEPARTURE) * own:
        yield (
            f"the trucks' limits stop the deck at ±{parts.reach:.3g} rad although its own range is ±{own:.3g} rad"
        )


def departures(joint: Parasitics) -> Iterator[str]:
    """Yield each quantity of the tilt joint that departs from the wanted one, with the parts that add it."""
    yield from _departure(joint, "stiffness", "N*m/rad", joint.whole)
    yield from _departure(joint, "damping", "N*m*s/rad", joint.whole)
    # An overdamped scene shows no inertia, but its deck alone does.
    swings = joint.whole.damping_ratio < 1
    yield from _departure(joint, "inertia", "kg*m^2", joint.whole if swings else joint.deck)


def _departure(joint: Parasitics, quantity: str, unit: str, seen: TiltJoint) -> Iterator[str]:
    wanted, value = getattr(joint.wanted, quantity), getattr(seen, quantity)
    if abs(value / wanted - 1) < MIN_DEPARTURE:
        return
    found = [
        f"{name} {getattr(part, quantity):+.3g}"
        for name, part in joint.parts
        if seen is joint.whole and name != DECK and abs(getattr(part, quantity)) > MIN_DEPARTURE * wanted
    ]
    alone = getattr(joint.deck, quantity)
    if abs(alone / wanted - 1) > MIN_DEPARTURE:
        found.append(f"the deck by itself {alone:.3g}")
    yield (
        f"{quantity} is {value:.4g} {unit}, expected {wanted:.4g} ({100 * (value / wanted - 1):+.0f} %): "
        + ", ".join(found or ["several parts add to it"])
    )
