"""Roll inertia: every method against the truth and Monte Carlo, their combination, the command."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import husky
from scipy.integrate import solve_ivp

from sysid import inertia
from sysid.board import Board, BoardEffect
from sysid.errors import SysidError
from sysid.experiments.static_tilt import Weighing, static_tilt
from sysid.quantity import GRAVITY, Quantity, parse_quantity
from sysid.workspace import Workspace

G = GRAVITY.value


def q(value: float, std: float, unit: str) -> Quantity:
    return Quantity(value, std, unit)


# --- quantities as text ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "unit", "value", "half"),
    [
        ("2.58±0.05", "kg", 2.58, 0.05),
        ("2.58+-0.05", "kg", 2.58, 0.05),
        ("2.58 +/- 0.05 kg", "kg", 2.58, 0.05),
        ("2580±50g", "kg", 2.58, 0.05),
        ("20±0.2cm", "m", 0.2, 0.002),
        (".5ms", "s", 0.0005, 0.0),
        ("90deg", "rad", math.pi / 2, 0.0),
        ("6.5Hz", "rad/s", 13 * math.pi, 0.0),
    ],
)
def test_quantity_text(text: str, unit: str, value: float, half: float) -> None:
    quantity = parse_quantity(text, unit)
    assert quantity.value == pytest.approx(value)
    assert quantity.ci95[1] - quantity.value == pytest.approx(half)
    assert quantity.unit == unit


@pytest.mark.parametrize(
    "text", ["", "x", "2.58±", "±1", "2.58±-1", "2.58 m", "1,5", "nan", "inf", "-1", "0", "1e999"]
)
def test_text_that_is_no_positive_mass(text: str) -> None:
    with pytest.raises(SysidError, match=r"--mass is '.*'; expected"):
        parse_quantity(text, "kg", "--mass")


# --- each method -------------------------------------------------------------------------------


def test_parts_agree_with_a_sum_over_particles() -> None:
    """A deck, a bolt across it and a sensor, each filled with random particles."""
    rng = np.random.default_rng(0)
    count = 400_000
    deck = rng.uniform((-0.1, -0.01), (0.1, 0.01), (count, 2)) + (0.02, 0.03)  # noqa: RUF005
    angle, radius = rng.uniform(0, 2 * np.pi, count), 0.02 * np.sqrt(rng.uniform(0, 1, count))
    bolt = np.column_stack((rng.uniform(-0.06, 0.06, count), radius * np.sin(angle) - 0.04))
    believed = 2.5 * np.mean(np.sum(deck**2, axis=1)) + 0.3 * np.mean(np.sum(bolt**2, axis=1)) + 0.1 * 0.05**2
    exact = inertia.parts([
        inertia.cuboid(q(2.5, 0, "kg"), q(0.2, 0, "m"), q(0.02, 0, "m"), q(math.hypot(0.02, 0.03), 0, "m")),
        inertia.cylinder(q(0.3, 0, "kg"), q(0.02, 0, "m"), q(0.12, 0, "m"), q(0.04, 0, "m")),
        inertia.point(q(0.1, 0, "kg"), q(0.05, 0, "m")),
    ])  # fmt: skip
    assert exact.value == pytest.approx(believed, rel=3e-3)


def swing_period(law: Callable[[float, float], float], start: float) -> float:
    """Period of a swing released from `start`, by integrating its exact equation of motion."""

    def crossing(_: float, y: np.ndarray) -> float:
        return y[0]

    crossing.direction = 1.0
    path = solve_ivp(
        lambda _, y: (y[1], law(y[0], y[1])), (0, 30), (start, 0.0), events=crossing, rtol=1e-10, atol=1e-12
    )
    return float(np.mean(np.diff(path.t_events[0][:5])))


def test_bifilar_swing_from_the_exact_motion() -> None:
    """The deck rises as the strings slant: height √(L² − 2a²(1 − cos θ)), energy conserved."""
    mass, separation, length, true = 2.5, 0.15, 1.2, 8.7e-3
    a = separation / 2

    def law(theta: float, rate: float) -> float:
        height = math.sqrt(length**2 - 2 * a**2 * (1 - math.cos(theta)))
        slope = -(a**2) * math.sin(theta) / height
        bend = -(a**2) * math.cos(theta) / height - slope**2 / height
        # L = ½(I + m h'²)θ̇² + m g h with h the depth below the hooks
        return (mass * G * slope - mass * slope * bend * rate**2) / (true + mass * slope**2)

    period = swing_period(law, math.radians(4))
    result = inertia.bifilar(q(mass, 0, "kg"), q(separation, 0, "m"), q(length, 0, "m"), q(period, 0, "s"))
    assert result.value == pytest.approx(true, rel=2e-3)
    moved = inertia.bifilar(
        q(mass, 0, "kg"), q(separation, 0, "m"), q(length, 0, "m"), q(period, 0, "s"), q(0.03, 0, "m")
    )
    assert moved.value - result.value == pytest.approx(mass * 0.03**2)


@pytest.mark.parametrize("amplitude", [0.02, 0.3])
def test_compound_pendulum_from_the_exact_motion(amplitude: float) -> None:
    mass, pivot, true = 2.5, 0.12, 8.7e-3
    about_pivot = true + mass * pivot**2
    period = swing_period(lambda theta, _: -mass * G * pivot * math.sin(theta) / about_pivot, amplitude)
    given_ = (q(mass, 0, "kg"), q(pivot, 0, "m"), q(period, 0, "s"))
    result = inertia.compound(*given_, amplitude=q(amplitude, 0, "rad"))
    assert result.value == pytest.approx(true, rel=1e-3)
    if amplitude > 0.1:  # without the correction the finite swing counts as inertia
        assert inertia.compound(*given_).value > 1.04 * true


@pytest.mark.parametrize("height", [0.0, 0.03, -0.02])
def test_added_mass_recovers_the_inertia(height: float) -> None:
    true, stiffness, mass, offset = 8.7e-3, 14.684, 0.8, 0.08
    more = mass * (offset**2 + height**2) + 1e-4
    bare = math.sqrt(stiffness / true)
    loaded = math.sqrt((stiffness - mass * G * height) / (true + more))
    result = inertia.added_mass(
        q(bare, 0, "rad/s"), q(loaded, 0, "rad/s"), q(mass, 0, "kg"), q(offset, 0, "m"), q(height, 0, "m"),
        q(1e-4, 0, "kg*m^2"),
    )  # fmt: skip
    assert result.value == pytest.approx(true)


def test_a_wire_and_a_known_inertia_count_from_the_tilt_axis() -> None:
    """A deck that twists on a wire has the period 2π √(I/κ); the parallel axis is that of the cuboid."""
    mass, distance = q(2.5, 0, "kg"), q(0.03, 0, "m")
    own = inertia.cuboid(mass, q(0.2, 0, "m"), q(0.02, 0, "m"))
    moved = inertia.cuboid(mass, q(0.2, 0, "m"), q(0.02, 0, "m"), distance)
    period = q(2 * math.pi * math.sqrt(own.value / 0.05), 0, "s")
    twisted = inertia.torsional(q(0.05, 0, "N*m/rad"), period, mass, distance)
    assert twisted.value == pytest.approx(moved.value)
    assert inertia.shifted(own, mass, distance).value == pytest.approx(moved.value)


def weighings(stiffness: float, rest: float, rng: np.random.Generator, blur: float) -> list[Weighing]:
    """Readings of a deck whose roll solves k (φ − φ₀) = m g r cos φ exactly, read with errors."""
    readings = []
    for mass, offset in [(0.5, 0.08), (1.0, 0.08), (1.5, 0.08), (0.5, -0.08), (1.0, -0.08), (1.5, -0.08)]:
        roll = rest
        for _ in range(60):
            roll = rest + mass * G * offset * math.cos(roll) / stiffness
        readings.append(
            Weighing(
                mass=q(mass, 1e-3, "kg"), offset=q(offset, 1e-6, "m"),
                roll=q(roll + blur * rng.standard_normal(), blur, "rad"),
            )
        )  # fmt: skip
    return readings


def test_static_tilt_recovers_stiffness_and_its_interval_holds() -> None:
    rng = np.random.default_rng(2)
    tests = [static_tilt(weighings(14.684, 0.02, rng, 2e-3)) for _ in range(600)]
    assert np.mean([t.stiffness.value for t in tests]) == pytest.approx(14.684, rel=2e-3)
    assert np.mean([t.rest.value for t in tests]) == pytest.approx(0.02, abs=2e-4)
    covered = [t.stiffness.ci95[0] < 14.684 < t.stiffness.ci95[1] for t in tests]
    assert 0.93 < np.mean(covered) < 0.995  # a little wide: where the scatter is larger, it counts
    assert np.mean([t.chi_square for t in tests]) == pytest.approx(4, rel=0.1)


METHODS: dict[str, tuple[Callable[..., Quantity], dict[str, Quantity]]] = {
    "bifilar": (
        inertia.bifilar,
        {"mass": q(2.58, 0.02, "kg"), "separation": q(0.15, 0.001, "m"), "length": q(1.2, 0.01, "m"),
         "period": q(1.7, 0.01, "s"), "distance": q(0.02, 0.001, "m")},
    ),
    "added-mass": (
        inertia.added_mass,
        {"bare": q(41.1, 0.1, "rad/s"), "loaded": q(32.6, 0.1, "rad/s"), "mass": q(0.8, 0.004, "kg"),
         "offset": q(0.08, 0.001, "m"), "height": q(0.01, 0.001, "m"), "own": q(1e-4, 1e-5, "kg*m^2")},
    ),
}  # fmt: skip
"""All methods propagate in the same way."""


@pytest.mark.parametrize("name", METHODS)
def test_uncertainty_agrees_with_monte_carlo(name: str) -> None:
    method, inputs = METHODS[name]
    rng = np.random.default_rng(7)
    draws = []
    for _ in range(4000):
        drawn = {
            key: Quantity(quantity.value + quantity.std * rng.standard_normal(), 0.0, quantity.unit)
            for key, quantity in {**inputs, "gravity": GRAVITY}.items()
        }
        draws.append(method(**drawn).value)
    result = method(**inputs)
    assert result.std == pytest.approx(np.std(draws), rel=0.05)
    assert result.value == pytest.approx(np.mean(draws), abs=0.1 * result.std)


# --- combination -------------------------------------------------------------------------------


def test_combination_is_the_weighted_mean() -> None:
    result = inertia.combine({"a": q(8e-3, 2e-4, "kg*m^2"), "b": q(8.3e-3, 1e-4, "kg*m^2")})
    weights = np.array([1 / 4, 1])
    assert result.inertia.value == pytest.approx(np.average([8e-3, 8.3e-3], weights=weights))
    assert result.inertia.std == pytest.approx(1e-4 / math.sqrt(1.25))
    assert result.agree
    assert result.odd_one is None


def test_the_method_that_stands_out_is_named_and_widens() -> None:
    sound = {"a": q(8.0e-3, 1e-4, "kg*m^2"), "b": q(8.1e-3, 1e-4, "kg*m^2"), "c": q(7.9e-3, 2e-4, "kg*m^2")}
    assert inertia.combine(sound).agree
    result = inertia.combine({**sound, "wrong": q(9.5e-3, 1e-4, "kg*m^2")})
    assert not result.agree
    assert result.odd_one == "wrong"
    assert result.inertia.std > 3 * inertia.combine(sound).inertia.std
    two = inertia.combine({"a": sound["a"], "wrong": q(9.5e-3, 1e-4, "kg*m^2")})
    assert not two.agree
    assert two.odd_one is None


# --- into the record ---------------------------------------------------------------------------


def test_new_inertia_of_a_fitted_board_scales_torques_and_drops_the_check(pink: Board) -> None:
    fitted = replace(
        pink.with_tilt(stiffness=q(15.0, 0.3, "N*m/rad")), fit={"rmse": 1e-3}, last_check={"passed": True},
        inertia=q(8.7e-3, 1e-4, "kg*m^2"),
        effects=(
            BoardEffect("stribeck", {"torque": q(0.1, 0.01, "N*m"), "velocity": q(0.5, 0.1, "rad/s")}),
            BoardEffect("preload", {"torque": q(0.0, 0.01, "N*m")}),
        ),
    )  # fmt: skip
    new = inertia.with_inertia(fitted, q(17.4e-3, 2e-4, "kg*m^2"))
    assert new.stiffness == pytest.approx(30.0)
    relative = math.sqrt(0.02**2 - (1e-4 / 8.7e-3) ** 2 + (2e-4 / 17.4e-3) ** 2)
    assert new.tilt["stiffness"].std == pytest.approx(30.0 * relative)
    assert new.effects[0].parameters["torque"].value == pytest.approx(0.2)
    assert new.effects[0].parameters["velocity"] == q(0.5, 0.1, "rad/s")
    assert new.effects[1].parameters["torque"].std == pytest.approx(0.02)
    assert new.last_check == {}


# --- the command -------------------------------------------------------------------------------

COMMANDS = {
    "cuboid": ("--mass", "2.58±0.05", "--width", "0.2+-0.002", "--height", "2±0.1cm"),
    "parts": ("--cuboid", "2.58±0.05,0.2,0.02,0.01", "--point", "0.3±0.01,0.05", "--body", "1e-4±1e-5,0.2,0.03"),
    "bifilar": ("--mass", "2.58", "--separation", "0.15±0.001", "--length", "1.2", "--period", "1.7±0.01"),
    "torsional": ("--stiffness", "0.05±0.001", "--period", "2.6±0.02"),
    "compound": ("--mass", "2.58", "--pivot", "0.1±0.001", "--period", "0.75", "--amplitude", "10deg"),
    "added-mass": ("--bare", "41.1±0.2", "--loaded", "5.2±0.03Hz", "--mass", "0.8", "--offset", "0.08±0.001"),
    "static-tilt": (
        "--reading", "0.5,0.08,1.55±0.1deg", "--reading", "1,0.08,3.05±0.1deg", "--reading",
        "1,-0.08,-3.1±0.1deg", "--frequency", "41.1±0.2",
    ),
    "combine": ("a=0.0087±0.0002", "b=0.0086±0.0001"),
}  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_every_method_has_a_command(tmp_path: Path, name: str) -> None:
    result = husky("inertia", name, *COMMANDS[name], "--json", "-", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    content = json.loads(result.stdout)
    assert content["method"] == name
    assert 1e-3 < content["inertia"]["value"] < 2e-2
    assert content["inertia"]["std"] > 0
    assert content["inertia"]["unit"] == "kg*m^2"
    assert list(tmp_path.iterdir()) == []


def test_save_puts_the_inertia_into_the_workspace(tmp_path: Path) -> None:
    result = husky("inertia", "cuboid", *COMMANDS["cuboid"], "--save", "pink", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "stiffness 14.684 ± 0.092 N·m/rad →" in result.stderr
    saved = Workspace(tmp_path).load_board("pink")
    assert saved.inertia.value == pytest.approx(2.58 * (0.2**2 + 0.02**2) / 12)
    assert saved.inertia.method == "uniform cuboid"
    result = husky("inertia", "cuboid", *COMMANDS["cuboid"], "--save", "pnk", cwd=tmp_path)
    assert result.returncode == 1
    assert "Did you mean 'pink'" in result.stderr


def test_two_synthetic_decays_and_a_known_mass_tell_the_true_inertia(tmp_path: Path) -> None:
    """From log to inertia with the tool's own commands; 0.8 kg at 80 mm on the compliant board."""
    ratio = 1 + 0.8 * 0.08**2 / 8.70e-3
    for name, effect in (("bare", "inertia=1"), ("loaded", f"inertia={ratio}")):
        made = husky(
            "synth", "--board", "pink", "--releases", "4", "-o", f"{name}.csv", "--effect", effect, cwd=tmp_path,
        )  # fmt: skip
        assert made.returncode == 0, made.stderr
        found = husky("decay", f"{name}.csv", "--board", "pink", "--json", f"{name}.json", cwd=tmp_path)
        assert found.returncode == 0, found.stderr
    frequencies = ("--bare", "bare.json", "--loaded", "loaded.json")
    mass = ("--mass", "0.8", "--offset", "80mm")
    result = husky("inertia", "added-mass", *frequencies, *mass, "--json", "-", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    inertia_found = json.loads(result.stdout)["inertia"]
    assert abs(inertia_found["value"] - 8.70e-3) < 3 * inertia_found["std"]
    assert inertia_found["std"] < 0.05 * 8.70e-3


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("cuboid", "--mass", "2.58kg", "--width", "wide", "--height", "1"), 1, "--width is 'wide'"),
        (("parts", "--cuboid", "1,2,3,4,5"), 1, "fields is 5; expected 3 or 4"),
        (("combine", "a=list.json", "b=1"), 1, "holds no quantity 'inertia'"),
        (("combine", "a=unit.json", "b=1"), 1, "is in 'g'; expected 'kg*m^2'"),
        (("static-tilt", *COMMANDS["static-tilt"][:6], "--save", "pink"), 1, "give the natural frequency"),
        (("cubiod",), 2, "cuboid"),
    ],
)
def test_command_refuses_in_one_line(
    tmp_path: Path, arguments: tuple[str, ...], code: int, message: str
) -> None:
    (tmp_path / "list.json").write_text("[]")
    (tmp_path / "unit.json").write_text('{"inertia": {"value": 1, "std": 1, "unit": "g"}}')
    result = husky("inertia", *arguments, cwd=tmp_path)
    assert result.returncode == code, result.stderr
    assert message in result.stderr + (result.stdout if code == 2 else "")
    if code == 1:
        assert result.stderr.startswith("error: ")
        assert result.stderr.count("\n") == 1
