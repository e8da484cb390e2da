"""Means with 95 % intervals, over episodes and over seeds."""

import math

import numpy as np

from sysid.quantity import Quantity
from sysid.roll import Array
from sysid.text import count


def proportion(successes: int, trials: int) -> Quantity:
    """Return a share with its Wilson 95 % interval, which stays within 0 and 1 (Wilson 1927)."""
    if trials == 0:
        return Quantity(math.nan, math.nan, "1", "no episode")
    from scipy.stats import binomtest

    share = successes / trials
    low, high = binomtest(successes, trials).proportion_ci(method="wilson")
    std = math.sqrt(share * (1 - share) / trials)
    return Quantity(share, std, "1", f"Wilson, {count(trials, 'episode')}", (float(low), float(high)))


def mean_over(values: list[Array], unit: str) -> Quantity:
    """Return the mean of a metric with its 95 % interval.

    From three seeds on the interval is Student's over the seeds' means, because episodes of a seed share boards
    and commands. With fewer it is over episodes.

    Args:
        values: One array of episode values for each seed; NaN are left out.
    """
    finite = [array[np.isfinite(array)] for array in values]
    everything = np.concatenate(finite) if finite else np.zeros(0)
    if len(everything) == 0:
        return Quantity(math.nan, math.nan, unit, "not measured in any episode")
    means = [float(array.mean()) for array in finite if len(array)]
    if len(means) >= 3:
        sample, over = np.array(means), "seeds"
    else:
        sample, over = everything, "episodes"
    mean = float(sample.mean())
    if len(sample) < 2:
        return Quantity(mean, math.nan, unit, "one episode")
    from scipy.stats import t

    error = float(sample.std(ddof=1)) / math.sqrt(len(sample))
    half = float(t.ppf(0.975, len(sample) - 1)) * error
    return Quantity(mean, error, unit, f"mean over {len(sample)} {over}", (mean - half, mean + half))
