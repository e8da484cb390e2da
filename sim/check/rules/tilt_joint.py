"""Stiffness, damping or inertia of the scene's tilt joint are not the record's, and which part of the scene adds it."""

from collections.abc import Iterator

from sim.check.rules._base import Rule
from sim.compensation.parasitics import DECK, Parasitics, TiltJoint

MIN_DEPARTURE = 0.03
"""Share of the wanted number below which a departure is not worth a word: on the shipped boards 3 % of stiffness alone is
an NRMSE of 1.0 %, of damping 1.4 %, of inertia 0.9 %, all within the gate's 2 %."""


def departures(joint: Parasitics) -> Iterator[str]:
    """Say which quantity of the joint departs from the wanted one, by how much, and from where."""
    yield from _departure(joint, "stiffness", "N*m/rad", joint.whole)
    yield from _departure(joint, "damping", "N*m*s/rad", joint.whole)
    # Where nothing swings, only the deck by itself still shows an inertia.
    swings = joint.whole.damping_ratio < 1
    yield from _departure(joint, "inertia", "kg*m^2", joint.whole if swings else joint.deck)


def _departure(joint: Parasitics, quantity: str, unit: str, seen: TiltJoint) -> Iterator[str]:
    wanted, value = getattr(joint.wanted, quantity), getattr(seen, quantity)
    if abs(value / wanted - 1) < MIN_DEPARTURE:
        return
    causes = [
        f"{name} {getattr(part, quantity):+.3g}"
        for name, part in joint.parts
        if seen is joint.whole and name != DECK and abs(getattr(part, quantity)) > MIN_DEPARTURE * wanted
    ]
    alone = getattr(joint.deck, quantity)
    if abs(alone / wanted - 1) > MIN_DEPARTURE:
        causes.append(f"the deck by itself {alone:.3g}")
    yield (
        f"{quantity} {value:.4g} {unit} where {wanted:.4g} is wanted ({100 * (value / wanted - 1):+.0f} %): "
        + ", ".join(causes or ["from several parts together"])
    )


RULE = Rule(order=5, asked=("failed",), says=lambda case: departures(case.joint), of_board=True)
