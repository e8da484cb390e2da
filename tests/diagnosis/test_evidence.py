"""Evidence in closed form against integration, and sets that grow against sets that are solved."""

import numpy as np
import pytest
from scipy.stats import norm

from sysid.diagnosis.evidence import (
    MOST_DEVIATIONS,
    STRENGTH,
    Item,
    Problem,
    grow,
    marginalised,
    search,
    single,
    solve,
)

FREE, POSITIVE = 0, 1


def problem_of(columns, truth, items, *, noise=1.0, seed=1, base=2, damping=100.0):
    """Return a problem of a log of 40 samples on random columns; those of the base come first."""
    rng = np.random.default_rng(seed)
    table = rng.normal(size=(40, columns))
    log = table @ truth + noise * rng.normal(size=40)
    every = np.column_stack([log, table]) / noise
    return Problem(every.T @ every, np.ones(base), items, damping)


def item(family, *columns, sign=FREE):
    return Item(family=family, columns=columns, signs=(sign,) * len(columns), log_prior=-2.0 - 0.1 * family)


def integral(problem, columns, signs, wide):
    """Return the log of ∫ exp(b'c - c'Gc/2) p(c) dc over the strengths that are possible, on a grid."""
    axes = [
        np.linspace(0 if s else -MOST_DEVIATIONS * w, MOST_DEVIATIONS * w, 161)
        for s, w in zip(signs, wide, strict=True)
    ]
    grids = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    gram = problem.gram[np.ix_(columns, columns)]
    log = grids @ problem.gram[columns, 0] - 0.5 * np.einsum("...i,ij,...j->...", grids, gram, grids)
    for i, (s, w) in enumerate(zip(signs, wide, strict=True)):
        log = log + norm.logpdf(grids[..., i], scale=w) + np.log(2 if s else 1)
    total = np.exp(log)
    for axis in reversed(axes):
        total = np.trapezoid(total, axis, axis=-1)
    return float(np.log(total))


@pytest.mark.parametrize("truth", [0.25, 0.02])
def test_one_column_is_integrated_with_its_sign(truth):
    items = [item(0, 3, sign=POSITIVE)]
    problem = problem_of(3, [0, 0, truth], items)
    problem.gram[1:3] = problem.gram[:, 1:3] = 0.0  # the log says nothing of the base
    found = solve(problem, (0,))
    expected = integral(problem, [3], [1], [STRENGTH]) + items[0].log_prior
    assert found.log_evidence == pytest.approx(expected, abs=2e-3)


def test_two_columns_beside_each_other_are_integrated():
    items = [item(0, 3), item(1, 4)]
    problem = problem_of(4, [0, 0, 0.3, -0.2], items)
    problem.gram[1:3] = problem.gram[:, 1:3] = 0.0
    found = solve(problem, (0, 1))
    expected = integral(problem, [3, 4], [0, 0], [STRENGTH] * 2) + sum(i.log_prior for i in items)
    assert found.log_evidence == pytest.approx(expected, abs=2e-3)


def test_a_set_that_grew_has_the_evidence_of_the_same_set_solved():
    items = [item(0, 3, sign=POSITIVE), item(0, 4), item(1, 5, 6, sign=POSITIVE), item(2, 7)]
    problem = problem_of(7, [0.5, 0.1, 0.3, 0, 0.2, -0.1, 0.4], items, damping=0.3)
    for parent in ((), (0,), (2,), (1, 2)):
        grown = grow(problem, solve(problem, parent))
        assert len(grown.items)
        for row, log in zip(grown.items, grown.log_evidence, strict=True):
            assert log == pytest.approx(solve(problem, [i for i in row if i >= 0]).log_evidence, abs=1e-8)


def test_what_is_negative_but_cannot_be_loses():
    free, held = ([item(0, 3, sign=sign)] for sign in (FREE, POSITIVE))
    logs = [solve(problem_of(3, [0, 0, -0.5], items, noise=0.1), (0,)).log_evidence for items in (free, held)]
    assert logs[0] - logs[1] > 20


def test_a_total_damping_below_zero_is_impossible():
    logs = [solve(problem_of(2, [0, -0.5], [], damping=d, noise=0.1), ()).log_evidence for d in (1.0, 0.1)]
    assert logs[0] - logs[1] > 20


def test_the_search_finds_the_true_set_of_families():
    items = [item(f, 3 + f) for f in range(6)]
    truth = [1, 0.2, 0, 0.4, 0, 0, -0.3, 0]
    problem = problem_of(8, truth, items, noise=0.1)
    sets = search(problem)
    assert sets.families[np.argmax(sets.log_evidence)] == 0b010010
    assert len(np.unique(sets.items, axis=0)) == len(sets.items)
    alone = single(problem, solve(problem, (4, 1)))
    assert (alone.items.tolist(), alone.families.tolist()) == ([[-1, 1, 4]], [0b010010])


def test_a_column_that_is_marginalised_is_integrated():
    problem = problem_of(3, [0, 0, 0.3], [])
    problem.gram[1:3] = problem.gram[:, 1:3] = 0.0
    gram, factor = marginalised(problem.gram[:4, :4], 3, np.array([STRENGTH]))
    change = -0.5 * gram[0, 0] + 0.5 * problem.gram[0, 0] + factor
    assert change == pytest.approx(integral(problem, [3], [0], [STRENGTH]), abs=2e-3)
