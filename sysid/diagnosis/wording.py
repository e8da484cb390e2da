"""The words of a verdict: lists of effects, shares, and the experiment that decides."""

from collections.abc import Mapping, Sequence

from sysid.effects import effect


def listed(names: Sequence[str]) -> str:
    """Return the effects with their titles, for a sentence."""
    return " and ".join(f"'{name}' ({effect(name).title})" for name in names)


def is_or_are(names: Sequence[str]) -> str:
    """Return 'is' or 'are'."""
    return "is" if len(names) == 1 else "are"


def it_or_them(names: Sequence[str]) -> str:
    """Return 'it' or 'them'."""
    return "it" if len(names) == 1 else "them"


def shares_in_words(shares: Mapping[str, float]) -> str:
    """Return how large each effect is against the joint's torque."""
    parts = [f"{name} peaks at {100 * share:.1f} % of the joint's torque" for name, share in shares.items()]
    return f"{'; '.join(parts).capitalize()}." if parts else ""


def deciding_experiment(named: Sequence[str], alike: Sequence[tuple[str, ...]]) -> str:
    """Return the experiment that decides between what is named and what looks like it."""
    others = [name for group in alike for name in group if name not in named]
    for name in (*named, *others):
        part = effect(name)
        if not others or set(part.look_alikes) & {*named, *others} or name in others:
            return part.experiment
    return effect(named[0]).experiment
