"""Every sentence of a verdict."""

from collections.abc import Sequence

from sysid.board import Board
from sysid.diagnosis.experiment import Experiment
from sysid.diagnosis.importance import Importance
from sysid.effects import catalogue, effect
from sysid.text import display


def listed(names: Sequence[str]) -> str:
    """Return the effects with their titles, for a sentence."""
    return " and ".join(f"'{name}' ({effect(name).title})" for name in names)


def is_or_are(names: Sequence[str]) -> str:
    """Return 'is' or 'are'."""
    return "is" if len(names) == 1 else "are"


def it_or_them(names: Sequence[str]) -> str:
    """Return 'it' or 'them'."""
    return "it" if len(names) == 1 else "them"


def size_in_words(size: Importance) -> str:
    """Return how large some effects are."""
    parts = [f"{name} peaks at {percent(share)} of the joint's torque" for name, share in size.each.items()]
    if size.energy_share > 0.005:
        parts.append(f"{percent(size.energy_share)} of the energy goes there")
    if size.amplitude_after_10_periods > 0.001:
        parts.append(
            f"after ten periods the swing differs by {percent(size.amplitude_after_10_periods)} of its start"
        )
    if size.signal_share > max(size.torque_share, size.energy_share, size.amplitude_after_10_periods):
        parts.append(f"it makes {percent(size.signal_share)} of the signal")
    text = "; ".join(parts)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def percent(share: float) -> str:
    """Return a share with two digits."""
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def experiment_in_words(
    found: Experiment | None, one: str, other: str, fallback: str, board: Board, limit: float
) -> str:
    """Return the experiment that decides between two models of a board, as a sentence with numbers.

    Args:
        found: The releases; None where none within the limit decides.
        one: The first of the models.
        other: The second.
        fallback: What else tells the first from its like.
        board: The record.
        limit: Widest angle of a release [rad].
    """
    show = display(is_rate=False, slides=board.slides)
    if found is None:
        return f"No release up to {show(limit, 2)}, made up to five times, tells {one} from {other} at 95 %. {fallback}".strip()
    right, left = (
        ("right edge down", "left edge down")
        if board.geometry
        else ("to the positive side", "to the negative side")
    )
    each = "" if found.number == 1 else " each"
    times = "once" if found.number == 1 else f"{found.number} times"
    return (
        f"Release {times} from {show.scale * abs(found.angle):.3g}{show.unit} ({right if found.angle > 0 else left}) and record {rounded(found.duration)} s{each}: "
        f"{one} and {other} then differ by up to {show(found.difference, 2)}, which decides at 95 %. {fallback}"
    ).strip()


def unfitted_rival(name: str) -> str:
    """Return what of a sensor's effect may be something that no model has, such as a hand, and how to tell; '' where all is fitted."""
    part = effect(name)
    others = [other for other in part.look_alikes if other not in catalogue()]
    if part.role != "measurement" or not others:
        return ""
    return f"What looks like {name} may be {' or '.join(others)}. {part.experiment}"


def experiment_for_the_unknown(seen: float, limit: float, board: Board) -> str:
    """Return what to record where no model is left that could predict an experiment, as a sentence with numbers.

    Args:
        seen: Largest tilt of the releases [rad].
        limit: Widest angle of a release [rad].
        board: The record.
    """
    show = display(is_rate=False, slides=board.slides)
    wider = f" and from {show(limit, 2)}" if limit > 1.05 * seen else ""
    return (
        f"None is computed, as no law that was tried predicts what another release would do. Release from {show(0.5 * seen, 2)}{wider} too, "
        "to both sides: what follows tilt or rate changes its share with the swing, what follows the time does not."
    )


def experiment_for_a_change() -> str:
    """Return what to record where the joint seems to change with time or between releases, as sentences."""
    return (
        "Repeat the first release later, from the same angle to the same side. If it decays otherwise, the joint changes with time, "
        "as by warming or loosening: fit early and late releases apart. If it decays as before, what changed comes back, or goes with "
        "the release angle."
    )


def rounded(number: float) -> str:
    """Return a number with two digits at least, never with an exponent."""
    return f"{number:.0f}" if number >= 10 else f"{number:.2g}"


def titles(names: Sequence[str]) -> str:
    """Return effects by their names, for a sentence about two models."""
    return " with ".join(names) if names else "the joint as it is"
