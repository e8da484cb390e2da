"""Nothing outside `sysid/effects` knows an effect by its name; a new one is one new file."""

import ast
import re
from pathlib import Path

import pytest

from sysid.effects import catalogue

ROOT = Path(__file__).parents[2]
OWNERS = ("sysid/effects", "sysid/synth", "sysid/cli/synth.py")
"""Rooms that may: the catalogue itself, and the independent truth that makes logs."""
WORDS = {"inertia", "gravity", "clock", "offset", "weight", "armature", "linkage", "payload", "learned"}
"""Effects whose names are everyday words: alone they may mean a quantity of the board, a channel of a log, a measure."""
LOOKUPS = {"effect", "with_effect", "parameters_from"}
"""Functions that take an effect's name."""


def literals(node: ast.AST) -> list[str]:
    """Return the strings in a part of a program."""
    found = (part.value for part in ast.walk(node) if isinstance(part, ast.Constant))
    return [value.strip() for value in found if isinstance(value, str)]


def keys(tree: ast.AST) -> list[str]:
    """Return the strings that are compared with a `.name`, or looked up in something called effects or a catalogue."""
    found = []
    for node in ast.walk(tree):
        # `effect(part.name).role` is no name, but what stands under it.
        if isinstance(node, ast.Compare) and re.search(r"\.name\b(?!\)\.)", ast.unparse(node)):
            found += literals(node)
        elif isinstance(node, ast.Subscript) and re.search("effect|catalogue", ast.unparse(node.value)):
            found += literals(node.slice)
        elif isinstance(node, ast.Call):
            function = ast.unparse(node.func)
            if function in LOOKUPS or re.search(r"(effect|catalogue).*\.get$", function):
                found += [text for argument in node.args[:1] for text in literals(argument)]
    return found


def names_in(source: str) -> list[str]:
    """Return the names of effects, and of their parameters, in a program's source."""
    tree = ast.parse(source)
    parameters = {f"{name}.{p}" for name, part in catalogue().items() for p in part.parameter_names}
    unmistakable = set(catalogue()) - WORDS | parameters
    quoted = [f"'{name}'" for name in catalogue()]
    texts = literals(tree)
    return (
        [text for text in texts if text in unmistakable]
        + [key for key in keys(tree) if key in WORDS]
        + [text for text in texts if any(name in text for name in quoted)]
    )


def test_no_effect_is_named_outside_the_catalogue():
    found = []
    for room in ("sysid", "sim", "reports", "policy_runtime"):
        for path in sorted((ROOT / room).rglob("*.py")):
            place = path.relative_to(ROOT).as_posix()
            if not place.startswith(OWNERS):
                found += [f"{place}: {name}" for name in names_in(path.read_text(encoding="utf-8"))]
    assert not found


TORQUE = '''
"""A spring like x⁵."""

from sysid.effects._base import MujocoSupport, Parameter, TorqueEffect, belongs_to_log


def torque(m, motion, parameters, states):
    return -parameters["coefficient"] * motion.tilt**5


EFFECT = TorqueEffect(
    name="fifth-power",
    title="a spring like x⁵",
    family="hardening",
    parameters=(
        Parameter(
            name="coefficient", unit="N*m/rad^5", size=lambda s: s.stiffness / s.amplitude**4, low=-0.9, high=20.0
        ),
    ),
    law="τ = -c x⁵",
    formula="{coefficient} φ⁵",
    source="a test",
    does="Wide swings are faster.",
    look_alikes=("cubic-stiffness",),
    experiment="Release from 3° and 12°.",
    mujoco=MujocoSupport(means="nothing", since="", warp=False),
    to_mjcf=belongs_to_log,
    example=(5000.0,),
    torque=torque,
)
'''
SENSOR = '''
"""A sensor whose scale is wrong."""

from dataclasses import replace

from sysid.effects._base import Parameter, SensorEffect


def observe(m, reading, parameters, states):
    wide = 1 + parameters["excess"] * reading.angle**2
    return replace(
        reading, angle=reading.angle * wide, rate=reading.rate * (1 + 3 * parameters["excess"] * reading.angle**2)
    )


EFFECT = SensorEffect(
    name="bent-scale",
    title="a scale that bends",
    family="drift",
    parameters=(
        Parameter(name="excess", unit="1/rad^2", size=lambda s: 1 / s.amplitude**2, low=-0.3, high=1.0, starts=(0.05,)),
    ),
    law="measured = φ (1 + e φ²)",
    source="a test",
    does="Wide swings read too large.",
    look_alikes=("quadratic-damping",),
    experiment="Compare with a protractor.",
    example=(2.0,),
    observe=observe,
)
'''


@pytest.fixture
def toys(tmp_path, monkeypatch):
    """A catalogue with two files more, from a folder that the repository does not have."""
    import sysid.effects

    (tmp_path / "fifth_power.py").write_text(TORQUE, encoding="utf-8")
    (tmp_path / "bent_scale.py").write_text(SENSOR, encoding="utf-8")
    monkeypatch.setattr(sysid.effects, "__path__", [*sysid.effects.__path__, str(tmp_path)])
    catalogue.cache_clear()
    yield
    catalogue.cache_clear()


@pytest.mark.parametrize(
    ("name", "value", "printed"),
    [("fifth-power", 5000.0, "+ 5e+03 φ⁵ = 0"), ("bent-scale", 2.0, "= τ(bent-scale)")],
)
@pytest.mark.parametrize("rate", [False, True])
@pytest.mark.usefixtures("toys")
def test_an_effect_is_one_file(name, value, printed, rate):
    """Found, simulated, fitted from angle and from rate, and printed, and no other file was touched."""
    from dataclasses import replace

    import numpy as np

    from sysid.fitting.joint import FitOptions, fit_joint
    from sysid.joint import JointLaw, simulate
    from sysid.roll import Release
    from sysid.workspace import Workspace

    board = replace(Workspace(ROOT).load_board("pink"), effects=())
    law = JointLaw(inertia=board.inertia.value, stiffness=14.7, damping=0.08).with_effect(name, value)
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 2.0, 2e-3)
    releases = []
    for number, angle in enumerate((0.2, -0.15), start=1):
        path = simulate(law, time, angle)
        noise = [1e-4 * rng.standard_normal(len(time)), 1e-3 * rng.standard_normal(len(time))]
        releases.append(
            Release(
                log="toy",
                number=number,
                time=time,
                roll=path.roll + noise[0],
                std=np.full(len(time), 1e-4),
                origin="angle",
                rate=path.rate + noise[1],
                rate_std=np.full(len(time), 1e-3),
                rest=0.0,
                hold=1.0,
                end="log",
            )
        )
    fit = fit_joint(releases, board, [name], FitOptions(use_rate=rate))
    (found,) = (quantity for key, quantity in fit.quantities.items() if key.startswith(name))
    assert abs(found.value - value) < 4 * found.std < 0.2 * value
    assert str(law).endswith(printed)
