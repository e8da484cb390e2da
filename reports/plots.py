"""Pictures of public results: into axes, and as the HTML that a notebook shows."""

import base64
import html as markup
import io
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.figures.compare import draw_pair
from reports.figures.palette import NOISE, REAL, SIM
from reports.figures.style import STYLE
from reports.figures.svg import thin
from sysid.board import Board
from sysid.comparison.compare import ComparedRelease, Comparison
from sysid.errors import SysidError
from sysid.fit_mjcf import Fit
from sysid.free_decay import FreeDecay
from sysid.joint import JointLaw, simulate
from sysid.joint.trajectory import Trajectory
from sysid.recording import Recording
from sysid.roll import Array, Release
from sysid.text import Display, display

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PERIODS = 4.0
"""Time for which a record's own decay is drawn, in natural periods."""


def plot(result: object, axes: "Axes | None" = None) -> "Axes":
    """Draw a public result.

    Args:
        result: A recording, a record, or the result of a verb.
        axes: Axes to draw into; new ones if None.

    Raises:
        SysidError: There is no picture of such a thing.
    """
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        if axes is None:
            import matplotlib.pyplot as plt

            axes = plt.subplots(layout="constrained")[1]
        _draw(result, axes)
    return axes


def html(result: Any) -> str:
    """Return the text of a result and its picture."""
    figure = _story(result) if isinstance(result, Fit) else None
    if figure is None:
        from matplotlib.figure import Figure

        figure = Figure(layout="constrained")
        plot(result, figure.subplots())
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    data = base64.b64encode(buffer.getvalue()).decode()
    text = markup.escape(result.brief())
    return f'<pre>{text}</pre><img style="max-width: 100%" alt="{text.splitlines()[0]}" src="data:image/png;base64,{data}">'


def _draw(result: object, axes: "Axes") -> None:
    from reports.figures.story import draw_candidates
    from reports.story import ranked
    from sim.check.verdict import Verdict
    from sysid.diagnosis.diagnose import Diagnosis

    match result:
        case Recording():
            _draw_recording(result, axes)
        case FreeDecay():
            from reports.figures.decay import draw_traces

            draw_traces(axes, result)
        case Comparison():
            _draw_comparison(result, axes)
        case Fit():
            _draw_fit(result, axes)
        case Verdict():
            _draw_check(result, axes)
        case Trajectory():
            axes.plot(*thin(result.time, result.roll), color=SIM)
            axes.set(xlabel="time since release [s]", ylabel="angle [rad]")
        case Board():
            _draw_record(result, axes)
        case Diagnosis():
            candidates = [(c.effects, c.score) for c in result.candidates]
            draw_candidates(axes, ranked(candidates, result.best.effects))
        case _:
            raise SysidError(f"there is no picture of a {type(result).__name__}.")


def _draw_recording(recording: Recording, axes: "Axes") -> None:
    """Draw the whole log, its free decays shaded."""
    roll = recording.roll
    show = display(is_rate=False, slides=roll.slides)
    axes.plot(*thin(roll.time, show.scale * roll.roll), color=REAL, lw=1.0)
    for release in recording.releases:
        axes.axvspan(release.start, float(release.time[-1]), color=SIM, alpha=0.12, lw=0)
    axes.set(xlabel="time [s]", ylabel=show.axis, title=f"{roll.log}: free decays in blue")


def _draw_comparison(result: Comparison, axes: "Axes") -> None:
    """Draw the release with the largest error, measured and simulated."""
    one = max(result.releases, key=lambda release: release.rmse)
    error = f"error {one.rmse / result.noise.std:.3g} × noise"
    _draw_pair(axes, one.time, (one.measured, one.simulated), result.show, "sim", one, error)


def _draw_fit(fit: Fit, axes: "Axes") -> None:
    """Draw the release with the largest error, measured and fitted."""
    pairs = zip(fit.joint.records, fit.joint.residuals, strict=True)
    record, residual = max(pairs, key=lambda pair: float(np.mean(pair[1] ** 2)))
    show = display(is_rate=record.is_rate, slides=fit.before.slides)
    error, motions = (
        f"error {fit.rmse / fit.noise.std:.3g} × noise",
        (record.signal, record.signal + residual),
    )
    _draw_pair(axes, record.time, motions, show, "fitted", record.release, error)


def _draw_check(verdict: Any, axes: "Axes") -> None:
    """Draw the decay with the largest error, measured and in the scene."""
    one = max(verdict.case.decays.releases, key=lambda release: release.nrmse)
    show = display(is_rate=False, slides=verdict.case.board.slides)
    time, error = one.release.time - one.release.time[0], f"NRMSE {100 * one.nrmse:.2f} %"
    _draw_pair(axes, time, (one.release.roll, one.simulated), show, "in the scene", one.release, error)


def _draw_pair(
    axes: "Axes", time: Array, motions: tuple[Array, Array], show: Display, name: str,
    release: Release | ComparedRelease, error: str,
) -> None:  # fmt: skip
    draw_pair(axes, time, show.scale * motions[0], show.scale * motions[1], name)
    title = f"{release.log}, release {release.number}: {error}"
    axes.set(xlabel="time since release [s]", ylabel=show.axis, title=title)
    axes.legend(loc="best")


def _draw_record(record: Board, axes: "Axes") -> None:
    """Draw the decay of the law from a quarter of its range."""
    if record.is_unmeasured and not record.effects:
        axes.text(0.5, 0.5, "nothing measured yet", ha="center", color=NOISE, transform=axes.transAxes)
        axes.set_axis_off()
        return
    law = JointLaw.from_board(record)
    time = np.linspace(0.0, PERIODS * 2 * np.pi / law.frequency, 400)
    path = simulate(law, time, law.rest_angle + record.tilt["range"].value / 4)
    show = display(is_rate=False, slides=record.slides)
    axes.plot(path.time, show.scale * path.roll, color=SIM)
    axes.set(xlabel="time since release [s]", ylabel=show.axis, title=f"{record.name}: {law}")


def _story(fit: Fit) -> "Figure | None":
    """Return the story of a fit: the record before and after; None without a record that moves."""
    from reports.figures.story import story_figure
    from reports.story import tell

    before = JointLaw.from_board(fit.before)
    if before.stiffness + before.stiffness_of_effects <= 0:
        return None
    known = {part.name for part in fit.before.effects}
    added = tuple(name for name, _ in fit.law.effects if name not in known)
    data, heldout = fit.recordings or fit.releases, fit.heldout_rmse / fit.noise.std
    story = tell(data, fit.before, laws=(before, fit.law), effects=added, heldout=heldout)
    return story_figure(story, f"{fit.before.name}: {fit.law}")
