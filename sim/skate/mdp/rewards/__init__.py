"""The reward (HUSKY, table of rewards): one file a purpose, found by being there.

Such a file ends in `REWARDS = Rewards(...)`. Its functions take the state and return a term's value before weight and
time step, shape (n,). Tolerances are those of the published release where the paper names none. Kernels of
headings, tilt and distance decay with the error, as in the release. The paper's Gaussians are flat far from the
goal.
"""

import importlib
import pkgutil

from sim.skate.mdp.rewards._base import Reward, Rewards, Task


def rewards(task: Task) -> tuple[Reward, ...]:
    """Return every term of a variant of the task, in the order in which they are summed."""
    modules = (name for _, name, _ in pkgutil.iter_modules(__path__) if name[0] != "_")
    found: list[Rewards] = [importlib.import_module(f"{__name__}.{name}").REWARDS for name in modules]
    return tuple(term for part in sorted(found, key=lambda part: part.order) for term in part.terms(task))
