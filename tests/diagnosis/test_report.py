"""What is printed of a diagnosis."""

from types import SimpleNamespace

import pytest

from sysid.diagnosis.report import STRETCHES, _predicted


def said(before, after, status):
    names = [f"a.csv, {i:.2f} to {i + 1:.2f} s" for i in range(len(before))]
    result = SimpleNamespace(heldout_before=before, heldout_after=after, status=status, stretches=names)
    return [
        [cell.strip() for cell in line.split("│")[1:-1]]
        for line in _predicted(result, 120).splitlines()
        if "│" in line
    ]


@pytest.mark.parametrize(
    ("before", "after", "status", "rows"),
    [
        ((1.004, 0.05), (0.0513, 0.02), "missing", [["a.csv, 0.00 to 1.00 s", "5.1 %", "100 %"], ["a.csv, 1.00 to 2.00 s", "2 %", "5 %"]]),
        ((9.96, 0.1), (9.96, 0.1), "unexplained", [["a.csv, 0.00 to 1.00 s", "996 %"], ["a.csv, 1.00 to 2.00 s", "10 %"]]),
        ((0.5,), (0.4,), "none-missing", [["thirds of the release", "50 %"]]),
    ],
)  # fmt: skip
def test_each_error_of_prediction_says_of_which_stretch_it_is(before, after, status, rows):
    assert said(before, after, status) == rows


def test_of_many_stretches_the_worst_are_told_in_their_order():
    errors = tuple(0.01 * (i % 7 + 1) for i in range(3 * STRETCHES))
    rows = said(errors, errors, "none-missing")
    assert len(rows) == STRETCHES
    assert [name for name, _ in rows] == sorted(
        (name for name, _ in rows), key=lambda name: float(name[7:].split()[0])
    )
    assert min(float(error[:-2]) for _, error in rows) >= 5
