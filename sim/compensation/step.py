"""Parameters that make the simulator's sampled decay the board's, at the step it is trained with.

A time step of milliseconds changes the decay: implicitfast at 5 ms takes 8.3 % off the stiff HUSKY board's damping ratio.
Stiffness, damping and roll inertia are three numbers for two poles. The stiffness stays, for it sets the static tilt under a
rider; a compensation by stiffness would make the board 20 % too stiff. So damping and roll inertia change.

Spring and damper alone have a closed form. With further effects the same two numbers are fitted.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sim.board.bodies import as_represented, law_of, left_out
from sim.board.clamped import ClampedScene
from sim.board.scene import integrator_name
from sysid.board import Board, BoardEffect
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.joint import JointLaw, simulate
from sysid.joint.sampled import continuous_map, joint_of_map
from sysid.joint.torques import memoryless_torque
from sysid.progress import steps
from sysid.roll import Array

UNKNOWN_RANGE, DEFAULT_RANGE = 3.1, 0.3
"""A tilt range of half a turn or more counts as unknown; the release is then from a deck's usual range [rad]."""
BELOW_BARRIER = 0.75
"""Energy of the widest release, over the energy at which the joint no longer returns [1]. For a spring that softens as x³ it is
0.7 of that angle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensation:
    """A board's written numbers for one integrator and step, with the remaining errors."""

    board: Board
    """The record with roll inertia and damping replaced; stiffness and effects are the record's."""
    timestep: float
    """[s]."""
    integrator: str
    inertia_ratio: float
    """Written roll inertia over the record's."""
    damping_ratio: float
    """Written damping over the record's."""
    decay_error: float
    """NRMSE of the unloaded decay against the law in continuous time, start fitted."""
    decay_error_before: float
    """The same with the record's own numbers."""
    static_error: float
    """Relative error of the static stiffness at the full tilt."""
    how: str
    """In words."""
    left_out: tuple[str, ...] = ()
    """Parts of the record that MuJoCo cannot represent, in words."""
    step_error: float = 0.0
    """NRMSE of the decay against the law without these parts: the cost of integrator and step alone."""

    def lines(self) -> tuple[str, ...]:
        """Return lines on the compensation and both errors, for output and for the comments of a file."""
        where = f"{self.how}, for {self.integrator} at {1e3 * self.timestep:g} ms"
        change, before = "as recorded", ""
        if self.inertia_ratio != 1 or self.damping_ratio != 1:
            inertia, damping = 100 * (self.inertia_ratio - 1), 100 * (self.damping_ratio - 1)
            change = f"roll inertia {inertia:+.1f} %, damping {damping:+.1f} %, stiffness kept"
            before = f" ({100 * self.decay_error_before:.2f} % without it)"
        return (
            f"{where}: {change}",
            f"unloaded decay: NRMSE {100 * self.decay_error:.3f} %{before}",
            *(
                f"{one}; apart from that the step costs {100 * self.step_error:.3f} %"
                for one in self.left_out
            ),
            f"static stiffness: {100 * self.static_error:+.3f} %",
        )


Build = Callable[[Board], ClampedScene]
"""Makes the scene of a candidate."""


def has_closed_form(board: Board) -> bool:
    """Return whether spring, damper and inertia are the whole joint."""
    return all(effect(part.name).role in ("measurement", "record") for part in board.effects)


def closed_form(board: Board, *, timestep: float, integrator: str = "implicitfast") -> Board:
    """Place the discrete poles of spring, damper and inertia where sampling puts the continuous ones.

    With k kept, inertia and damping follow from the trace and the determinant of the map that a step is.

    Args:
        board: The record, in physical parameters. Only the effects that scale the inertia count.
        timestep: [s].
        integrator: MuJoCo's name of the integrator. RK4 needs no compensation.

    Raises:
        SysidError: The spring swings more than half a period in one step, or the integrator damps
            more than the board.
    """
    ratio = law_of(board).inertia_ratio
    inertia, k, d = ratio * board.inertia.value, board.stiffness, board.damping
    turning = math.sqrt(max(4 * inertia * k - d * d, 0.0)) / (2 * inertia)
    if turning * timestep >= math.pi:
        raise SysidError(
            f"a step of {timestep:g} s is too long for board '{board.name}': its half period is "
            f"{math.pi / turning:.3g} s. Choose a smaller --timestep."
        )
    if integrator == "RK4" or k == 0:  # a weight has no closed form
        return board
    trace, determinant = continuous_map(inertia, k, d, timestep)
    new_inertia, new_damping = joint_of_map(trace, determinant, k, timestep, integrator)
    if new_damping < 0:
        raise SysidError(
            f"MuJoCo's integrator '{integrator}' at {timestep:g} s damps more than board '{board.name}' does; "
            f"damping would have to be {new_damping:.3g} N*m*s/rad. Choose implicitfast or a smaller step."
        )
    return _with(board, new_inertia / ratio, new_damping)


def release_amplitudes(board: Board) -> tuple[float, ...]:
    """Return the angles about rest from which decays are compared [rad]: both sides, wide and narrow.

    Wide is the tilt range, if it is known, up to where the joint still returns. The error of a step depends on the amplitude
    where the joint is not linear.
    """
    known = board.tilt["range"].value
    wide = _comes_back_from(board, known if known < UNKNOWN_RANGE else DEFAULT_RANGE)
    return wide, -0.7 * wide, 0.4 * wide


def _comes_back_from(board: Board, wide: float) -> float:
    """Return the widest tilt up to `wide` from which a release stays where the joint pulls back [rad]."""
    tilt = np.linspace(0.0, 1.2 * wide, 481)[1:]  # a barrier just beyond slows a release too
    pulls = [-side * _static_torque(board, side * tilt) for side in (1.0, -1.0)]
    energies = [np.cumsum(pull) * tilt[0] for pull in pulls]
    barrier = math.inf
    for pull, energy in zip(pulls, energies, strict=True):
        rounding = 1e-9 * float(np.max(np.abs(pull)))
        begun = int(np.argmax(pull > rounding))  # preload or play: it pulls back from some angle on
        lost = np.flatnonzero(pull[begun:] < -rounding)
        barrier = min(barrier, float(energy[begun + lost[0]]) if len(lost) else math.inf)
    beyond = np.flatnonzero(np.max(energies, axis=0) > BELOW_BARRIER * barrier)
    return min(float(tilt[max(beyond[0] - 1, 0)]), wide) if len(beyond) else wide


def _static_torque(board: Board, tilt: Array) -> Array:
    """Return the law's static torque at tilts about the rest angle [N*m], without effects with memory."""
    return memoryless_torque(JointLaw.from_board(board), board.rest_angle + tilt, 0.0 * tilt)


def fit_inertia_and_damping(board: Board, start: Board, build: Build, amplitudes: Sequence[float]) -> Board:
    """Fit roll inertia and damping so that MuJoCo's decay is the law's; start rates are free.

    The parameters of a second body (support or hanging) are fitted too. Parts that MuJoCo cannot represent are left out of the
    law: the joint's damper would replace a stop's, and be wrong below the stop.

    Args:
        amplitudes: Releases, as angles about rest [rad].
    """
    from scipy.optimize import least_squares

    step = build(start).model.opt.timestep
    truth = _truth(as_represented(board), amplitudes)
    turned = 2 + sum(len(effect(part.name).stepped) for part in start.effects)

    def misfit(knobs: Array) -> Array:
        next(bar, None)
        scene = build(_knobs(start, knobs))
        return np.concatenate(
            [_residual(scene, each, rate) for each, rate in zip(truth, knobs[turned:], strict=True)]
        )

    rates = [release.lag(step) for release in truth]
    guess = [0.0] * turned + rates
    # Half a step against a stop may change the speed by more than the board's own.
    reach = [1.5] * turned + [max(1.0, 2 * abs(rate)) for rate in rates]
    bounds, tries = (-np.array(reach), reach), 25
    bar = iter(steps(range(tries * (len(guess) + 1))))
    found = least_squares(misfit, guess, bounds=bounds, diff_step=1e-4, xtol=1e-7, ftol=1e-9, max_nfev=tries)
    return _knobs(start, found.x)


def evaluate(
    board: Board, written: Board, build: Build, amplitudes: Sequence[float], how: str
) -> Compensation:
    """Measure both errors of a written board in MuJoCo: unloaded decay and static stiffness."""
    scene = build(written)
    error = step_error = decay_error(board, scene, amplitudes)
    if (lacking := as_represented(board)) != board:
        step_error = decay_error(lacking, scene, amplitudes)
    return Compensation(
        board=written, timestep=float(scene.model.opt.timestep), integrator=integrator_name(scene.model),
        inertia_ratio=written.inertia.value / board.inertia.value,
        damping_ratio=written.damping / board.damping if board.damping else 1.0, decay_error=error,
        decay_error_before=error if written is board else decay_error(board, build(board), amplitudes),
        static_error=_static_error(board, build, written), how=how, left_out=left_out(board),
        step_error=step_error,
    )  # fmt: skip


def decay_error(board: Board, scene: ClampedScene, amplitudes: Sequence[float]) -> float:
    """Return the NRMSE of MuJoCo's decays against the law's; the start rate of each is fitted.

    In a semi-implicit step, velocity lags position by half a step, so the rate at release is free.
    """
    from scipy.optimize import least_squares

    square, power = 0.0, 0.0
    for release in _truth(board, amplitudes):

        def misfit(rate: Array, release: _Release = release) -> Array:
            return _residual(scene, release, float(rate[0]))

        found = least_squares(misfit, [release.lag(scene.model.opt.timestep)], diff_step=1e-4, max_nfev=8)
        square += 2 * float(found.cost)
        power += float(np.sum((release.roll / release.scale) ** 2))
    return math.sqrt(square / power)


@dataclass(frozen=True, slots=True)
class _Release:
    """A decay of the law in continuous time."""

    angle: float
    time: Array
    roll: Array
    """About rest."""
    rest: float
    speed: float
    """Amplitude times natural frequency [rad/s]."""
    deceleration: float
    """Roll acceleration at the release [rad/s²]."""

    @property
    def scale(self) -> float:
        """RMS of the release, by which wide and narrow ones count alike [rad]."""
        return float(np.sqrt(np.mean(self.roll**2)))

    def lag(self, step: float) -> float:
        """Return the rate half a step [s] before the release, in units of `speed`."""
        return -step / 2 * self.deceleration / self.speed


def _truth(board: Board, amplitudes: Sequence[float]) -> list[_Release]:
    law = JointLaw.from_board(board).of_joint()
    if law.stiffness + law.stiffness_of_effects <= 0:
        raise SysidError(
            f"nothing pulls the joint of '{board.name}' back to rest: its record has a stiffness of {law.stiffness:g} N·m/rad. "
            f"Was it never fitted? `husky-sysid fit LOG --board {board.name}` measures it."
        )
    decay = max(law.damping / (2 * law.inertia), 0.02 * law.frequency)
    duration = min(4.0 / decay, 12 * 2 * math.pi / law.frequency)
    time = np.linspace(0.0, duration, 400)
    releases: list[_Release] = []
    for amplitude in amplitudes:
        angle = law.rest_angle + amplitude
        about_rest = simulate(law, time, angle, 0.0).roll - law.rest_angle
        begun = float(simulate(law, np.array([0.0, 1e-4]), angle, 0.0).rate[-1] / 1e-4)
        speed = abs(amplitude) * law.frequency
        releases.append(_Release(angle, time, about_rest, law.rest_angle, speed, begun))
    return releases


def _residual(scene: ClampedScene, release: _Release, rate: float) -> Array:
    """Return MuJoCo's decay less the law's, from a rate in units of the release's speed, over the release's size."""
    from scipy.interpolate import CubicSpline

    moved = CubicSpline(*scene.swing(release.angle, rate * release.speed, float(release.time[-1])))
    return (moved(release.time) - release.rest - release.roll) / release.scale


def _static_error(board: Board, build: Build, written: Board) -> float:
    """Compare MuJoCo's static torque at the full tilt with the law's, without effects with memory."""
    elastic = tuple(part for part in board.effects if not effect(part.name).states)
    scene = build(replace(written, effects=elastic))
    where, tilt = scene.model.joint(scene.joint), board.tilt["range"].value
    simulated = expected = 0.0
    for x in (tilt, -tilt):
        data = mujoco.MjData(scene.model)
        data.qpos[where.qposadr[0]] = board.rest_angle + x
        mujoco.mj_forward(scene.model, data)
        torque = data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator
        simulated += math.copysign(1.0, x) * float(torque[where.dofadr[0]])
        expected += math.copysign(1.0, x) * float(_static_torque(board, np.array(x)))
    return simulated / expected - 1


def _knobs(board: Board, knobs: Array) -> Board:
    """Return the board with other roll inertia, damping and parameters of second bodies; knobs are logarithms of factors."""
    others = iter(knobs[2:])
    effects: list[BoardEffect] = []
    for part in board.effects:
        turned = {
            name: replace(part.parameters[name], value=part.parameters[name].value * math.exp(next(others)))
            for name in effect(part.name).stepped
        }
        effects.append(replace(part, parameters={**part.parameters, **turned}))
    board = replace(board, effects=tuple(effects))
    return _with(board, board.inertia.value * math.exp(knobs[0]), board.damping * math.exp(knobs[1]))


def _with(board: Board, inertia: float, damping: float) -> Board:
    written = board.with_tilt(damping=replace(board.tilt["damping"], value=damping))
    return replace(written, inertia=replace(board.inertia, value=inertia))
