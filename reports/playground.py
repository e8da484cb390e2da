"""Interactive decay of a board in a page: the law as JavaScript, sliders for its numbers, and the measured releases.

The page runs the CasADi graph of the joint itself, printed as JavaScript (`reports.javascript`), so that laws, integration step,
internal states and sensor have one source. Each effect has an amount, a factor on its torque: 0 removes it, 1 is the fitted effect.
"""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from reports.evidence import Evidence, LastDiagnosis
from reports.javascript import javascript
from reports.story import RECORD, STOOD, law_of_candidate, release_name
from sysid.board import Board
from sysid.effects import effect
from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import Effect, JointState, LinearJoint, Parameter, SensorEffect, TorqueEffect
from sysid.fitting.initial_state import problems_of_law
from sysid.fitting.joint import FitOptions, held_parameters
from sysid.fitting.problem import Problem
from sysid.fitting.records import Record, make_records, signal_of
from sysid.joint import JointLaw
from sysid.joint.equations import EquationsOfMotion
from sysid.joint.integrator import build_stepper
from sysid.joint.sensor import at_samples, clock_ratio, filtered, reader
from sysid.joint.structure import Structure
from sysid.quantity import printed, slide_unit
from sysid.roll import Array
from sysid.text import display

MOST_SAMPLES = 12_000
"""Samples in a page; longer logs are averaged over neighbours."""
AMOUNT = Parameter(name="amount", unit="1", size=lambda s: 1.0, low=0.0, high=2.0)


@dataclass(frozen=True, slots=True)
class Preset:
    """A law to begin from."""

    label: str
    law: JointLaw
    vector: tuple[float, ...]
    """Its numbers, as the page's law orders them."""
    spreads: tuple[float | None, ...]
    """Largest rate at the start of each release [rad/s]; None for a pushed one."""
    zeros: bool
    """Whether the sensor's zero differs between releases."""


@dataclass(frozen=True, slots=True)
class Sliding(Structure):
    """A joint whose torques have an amount each."""

    amounted: tuple[TorqueEffect, ...] = ()

    @property
    def parts(self) -> tuple[Effect, ...]:
        """The effects themselves."""
        return (*(effect(name) for name in self.effects), *self.amounted)


@dataclass(frozen=True, slots=True, kw_only=True)
class Playground:
    """All that a page needs to simulate a board."""

    code: str
    """JavaScript: `initial`, `held`, `step`, `cut`, `output`, `reading`."""
    presets: tuple[Preset, ...]
    """As it stood, refitted, and with effects."""
    sliders: tuple[Mapping[str, Any], ...]
    releases: tuple[Mapping[str, Any], ...]
    settings: Mapping[str, Any]
    left_out: tuple[str, ...]
    """Effects of the laws that have no slider."""

    def to_json(self) -> dict[str, Any]:
        """Return the data for the page's script."""
        return {
            "presets": [
                {"label": p.label, "vector": p.vector, "spreads": p.spreads, "zeros": p.zeros}
                for p in self.presets
            ],
            "sliders": self.sliders,
            "releases": self.releases,
            **self.settings,
        }


def playground(evidence: Evidence, diagnosis: LastDiagnosis | None) -> Playground | None:
    """Return a board's playground; None for a law that stands for a simulator's step."""
    laws = _laws(evidence, diagnosis)
    if laws[-1][1].timestep:
        return None
    own = {name for name, _ in evidence.comparison.law.effects}
    extra = {name for _, law in laws for name, _ in law.effects} - own
    # An effect that some laws lack must be able to vanish.
    needed = {name for name in own if not (_slides(effect(name)) or _vanishes(effect(name)))}
    allowed = own | {name for name in extra if _slides(effect(name)) or _vanishes(effect(name))}
    laws = [(label, law) for label, law in laws if needed <= {name for name, _ in law.effects} <= allowed]
    last = laws[-1][1]
    names = sorted({name for _, law in laws for name, _ in law.effects})
    sliding = [name for name in names if _slides(effect(name))]
    structure = Sliding(
        tuple(name for name in names if name not in sliding), tuple(_amounted(effect(name)) for name in sliding)
    )  # fmt: skip
    floor = evidence.comparison.noise.std
    records = make_records(evidence.releases, floor, rate=evidence.comparison.is_rate)
    presets = _presets(evidence, laws, structure, records)
    ratio = clock_ratio(structure, dict(zip(structure.parameters, presets[0].vector, strict=True)))
    width = -(-sum(len(record.time) for record in records) // MOST_SAMPLES)
    free_states = bool(structure.internal_states) and any(r.release.hold <= 0 for r in records)
    scales = problems_of_law(last, records)[0].scales
    sizes = [scales.amplitude, scales.rate]
    sizes += [state.size(scales) for state in structure.internal_states] if free_states else []
    sizes.append(scales.amplitude)
    frequency = max(law.frequency for _, law in laws)
    rest = [not isinstance(part, SensorEffect) for part in structure.parts for _ in part.states]
    return Playground(
        code=_code(structure, free_states=free_states),
        presets=tuple(presets),
        sliders=tuple(_sliders(evidence.board, structure, presets, scales.amplitude)),
        releases=tuple(
            _release(evidence, structure, i, record.time, record.signal, width, ratio)
            for i, record in enumerate(records)
        ),
        settings={
            "begin": len(laws) - 1,
            "noise": floor,
            "isRate": evidence.comparison.is_rate,
            "axis": evidence.comparison.show.axis,
            "scale": evidence.comparison.show.scale,
            "step": 2 * np.pi / frequency / FitOptions().steps_per_period / (3 if structure.nonsmooth else 1),
            "sizes": sizes,
            "internal": [2 + i for i, is_own in enumerate(rest) if is_own] if free_states else [],
            "turns": structure.has_dry_friction,
            "reads": bool(at_samples(structure)),
            "ratio": ratio,
        },
        left_out=tuple(sorted((own | extra) - set(sliding))),
    )


def _presets(
    evidence: Evidence, laws: Sequence[tuple[str, JointLaw]], structure: Structure, records: Sequence[Record]
) -> list[Preset]:
    """Return the laws as presets of the sliders."""
    known = {name: values for _, law in reversed(laws) for name, values in law.effects}
    options = FitOptions(**signal_of(evidence.releases))
    return [
        Preset(
            label, law, _vector(structure, law, known), _spreads(problems_of_law(law, records)),
            held_parameters(law.structure, evidence.board, options)[1] == "per-release",
        )
        for label, law in laws
    ]  # fmt: skip


def _laws(evidence: Evidence, diagnosis: LastDiagnosis | None) -> list[tuple[str, JointLaw]]:
    """Return the laws of the buttons, the initial one last: as it stood, of the record, and of a current diagnosis."""
    laws = {evidence.stood: STOOD}
    laws.setdefault(evidence.comparison.law, RECORD)
    if diagnosis is not None and diagnosis.is_current and diagnosis.content["best"]["effects"]:
        best = diagnosis.content["best"]
        law = law_of_candidate(evidence.board, best)
        if law is not None:
            laws[law] = f"+ {' + '.join(best['effects'])}"
    return [(label, law) for law, label in laws.items()]


def _slides(part: Effect) -> bool:
    """Whether an effect can be had in part: its torque times something."""
    return isinstance(part, TorqueEffect) and not part.timestep and part.changing is None


def _vanishes(part: Effect) -> bool:
    """Whether a sensor's effect can vanish, and has neither states nor another clock."""
    plain = isinstance(part, SensorEffect) and not part.states and not part.clock_ratio
    return plain and all(parameter.neutral is not None for parameter in part.parameters)


def _amounted(part: Effect) -> TorqueEffect:
    """Return an effect with one more parameter: a factor of its torque."""
    assert isinstance(part, TorqueEffect)
    friction, modifies = part.friction, part.modifies

    def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
        return parameters["amount"] * part.torque(m, motion, parameters, states)

    def shared_friction(m: Algebra, tilt: Value, speed: Value, parameters: Values) -> Value:
        assert friction is not None
        return parameters["amount"] * friction(m, tilt, speed, parameters)

    def modified(joint: LinearJoint, parameters: Values) -> LinearJoint:
        assert modifies is not None
        new, amount = modifies(joint, parameters), parameters["amount"]
        mixed = {
            f.name: amount * getattr(new, f.name) + (1 - amount) * getattr(joint, f.name)
            for f in fields(joint)
        }
        return LinearJoint(**mixed)

    return replace(
        part,
        parameters=(*part.parameters, AMOUNT),
        torque=torque,
        friction=None if friction is None else shared_friction,
        modifies=None if modifies is None else modified,
    )


def _vector(structure: Structure, law: JointLaw, known: Mapping[str, Sequence[float]]) -> tuple[float, ...]:
    """Return the numbers of a law as a structure with more effects orders them, those it lacks as `known` has them."""
    mine = dict(law.effects)
    vector = [law.inertia, law.stiffness, law.damping, law.rest_angle]
    for part in structure.parts:
        if _slides(part):
            vector += [*mine.get(part.name, known[part.name]), float(part.name in mine)]
        else:
            vector += mine.get(part.name) or [
                float(parameter.neutral or 0.0) for parameter in part.parameters
            ]
    return tuple(map(float, vector))


def _spreads(problems: Sequence[Problem]) -> tuple[float | None, ...]:
    limits = [problem.start_limit(0, problem.start(problem.fixed))[1] for problem in problems]
    return tuple(limit if np.isfinite(limit) else None for limit in limits)


def _sliders(
    board: Board, structure: Structure, presets: Sequence[Preset], amplitude: float
) -> list[dict[str, Any]]:
    """Return sliders for spring, damper, rest angle and the amount of each effect.

    `index` is that of its number in the law; `shown` that of the number that is shown times this one, -1 to show this one
    alone. `scale` is from SI to the unit.
    """
    alone = {"shown": -1, "scale": 1.0}
    vectors = np.array([preset.vector for preset in presets])
    sliders: list[dict[str, Any]] = []
    for index, name, symbol in ((1, "stiffness", "k"), (2, "damping", "d")):
        low, reach = float(vectors[:, index].min()), float(np.abs(vectors[:, index]).max())
        if reach:  # not every joint has a spring
            unit = printed(board.tilt[name].unit)
            ends = {"low": min(0.3 * low, 0.0), "high": 2 * reach}
            sliders.append({"label": f"{name} {symbol}", "unit": unit, "index": index, **ends, **alone})
    reach = 2 * max(float(np.abs(vectors[:, 3]).max()), amplitude / 4)
    show = display(is_rate=False, slides=board.slides)
    rest = {"label": "rest", "unit": show.unit.strip(), "index": 3, "low": -reach, "high": reach}
    sliders.append({**rest, **alone, "scale": show.scale})
    for part, where, _ in structure.layout():
        if _slides(part):
            label, unit, shown = part.title, "× fitted", -1
            first = part.parameters[0]
            if first.neutral == 0:  # its strength
                label, shown = f"{label}: {first.name.replace('_', ' ')}", where.start
                unit = printed(slide_unit(first.unit) if board.slides else first.unit)
            amount = {"label": label, "unit": unit, "index": where.stop - 1, "low": 0.0, "high": 2.0}
            sliders.append({**amount, **alone, "shown": shown})
    return sliders


def _release(
    evidence: Evidence, structure: Structure, index: int, time: Array, signal: Array, width: int, ratio: float
) -> dict[str, Any]:
    """Return the samples of one release for the page: means of `width` neighbours, and their scatter."""
    release, simulated = evidence.releases[index], evidence.comparison.releases[index]
    used = len(time) // width * width
    means = [part[:used].reshape(-1, width).mean(axis=1) for part in (time, signal, simulated.residual)]
    inside = float(np.sum(simulated.residual[:used] ** 2) - width * np.sum(means[2] ** 2))
    rest = float(np.sum(simulated.residual[used:] ** 2))
    return {
        "label": release_name(evidence.comparison, index),
        "time": _packed(means[0] / ratio),
        "signal": _packed(means[1]),
        "width": width,
        "known": [[structure.parameters.index(name), value] for name, value in release.known.items()],
        "samples": len(time),
        "scatter": inside + rest,
        "hold": max(release.hold, 0.0),
        "begin": release.start,
        "inward": -float(np.sign(release.roll[0] - release.rest)),
        "guess": [float(simulated.roll[0]), 0.0 if release.hold > 0 else float(simulated.rate[0])],
    }


def _packed(values: Array) -> dict[str, Any]:
    """Return numbers as their differences from a straight line, in single precision and base 64."""
    line = np.linspace(values[0], values[-1], len(values))
    left = (values - line).astype("<f4")
    return {"from": float(values[0]), "to": float(values[-1]), "left": b64encode(left.tobytes()).decode()}


def _code(structure: Structure, *, free_states: bool) -> str:
    """Return the joint in JavaScript: its state at release, its step, the output of its filters and the reading."""
    import casadi

    ca: Any = casadi
    p = ca.SX.sym("p", len(structure.parameters))
    y, h = ca.SX.sym("y", 2 + len(structure.states)), ca.SX.sym("h")
    equations = EquationsOfMotion(structure, p)
    held = build_stepper(structure, free_states=False, sensitivities=False).initial
    functions = {
        "held": held,
        "initial": build_stepper(structure, free_states=True, sensitivities=False).initial
        if free_states
        else held,
        "output": ca.Function("f", [y, p], [ca.vertcat(*filtered(equations, y))]),
    }
    if structure.has_dry_friction:
        slide = equations.sliding(y)
        whole = equations.rk4(y, h, slide)
        turned = equations.turned(y, whole, slide)
        functions["step"] = ca.Function("f", [y, p, h], ca.cse([ca.densify(whole), turned]))
        functions["cut"] = ca.Function("f", [y, p, h], ca.cse([ca.densify(equations.event_step(y, h))]))
    else:
        functions["step"] = ca.Function("f", [y, p, h], ca.cse([ca.densify(equations.rk4(y, h, None))]))
    if at_samples(structure):
        read = [ca.SX.sym(name) for name in ("angle", "rate", "time")]
        functions["reading"] = ca.Function("f", [*read, p], [reader(structure)(*read, p)[0]])
    return "".join(javascript(function, name) for name, function in functions.items())
