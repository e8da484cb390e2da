"""The picture of a training run."""

from matplotlib import rc_context

from policy_runtime.learning.curves import draw_curves


def test_the_title_of_thinned_curves_counts_every_iteration(tmp_path):
    columns = [
        "survival",
        "falls_per_minute",
        "speed_error",
        "heading_error",
        "both_feet",
        "foot_down",
        "reward",
        "style",
    ]
    row = dict.fromkeys(columns, 0.5) | {"collect_s": 0.5, "learn_s": 0.1}
    rows = [row | {"iteration": n, "samples": n * 100_000} for n in range(5, 501, 5)]
    with rc_context({"svg.fonttype": "none"}):
        picture = draw_curves(rows, tmp_path / "curves.svg", "pink")
    assert "pink: 500 iterations, 50 million steps, 5 min" in picture.read_text()
