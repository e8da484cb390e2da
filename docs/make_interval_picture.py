"""Draw the picture of docs/intervals.md: three intervals of each parameter of the shipped hidden-friction log.

python docs/make_interval_picture.py
"""

from pathlib import Path

from reports.figures.intervals import interval_figure
from sysid.board import load_board
from sysid.fitting.bootstrap import bootstrap
from sysid.fitting.joint import fit_joint
from sysid.fitting.profile import profiles
from sysid.logs import read_roll
from sysid.releases import find_releases

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Fit, profile, draw again, and save."""
    board = load_board(ROOT / "data/boards/pink.toml")
    fit = fit_joint(find_releases(read_roll(ROOT / "data/decays/pink_hidden.csv")), board, ["coulomb"])
    title = "pink, with dry friction: how far each parameter can move while the others follow"
    figure = interval_figure(fit.quantities, list(profiles(fit, board)), bootstrap(fit, board, 1000), title)
    figure.savefig(ROOT / "docs/pictures/intervals.png", dpi=110)


if __name__ == "__main__":
    main()
