"""The page simulates what Python simulates: the same law, the same fitted starts, the same error."""

from dataclasses import replace

import numpy as np
import pytest
from decay_truth import Recipe, make_roll

from reports.evidence import Evidence, LastDiagnosis
from reports.page.page import Page, sliders
from reports.playground import playground
from sysid.board import BoardEffect
from sysid.comparison.compare import compare
from sysid.effects import effect
from sysid.joint import JointLaw
from sysid.quantity import Quantity
from sysid.recording import Recording

STIFF, DAMP = 14.68, 0.06


def with_effects(board, **effects):
    """The board, light, with effects at given parameters."""
    own = []
    for name, values in effects.items():
        part = effect(name.replace("_", "-"))
        pairs = zip(part.parameters, values, strict=True)
        own.append(BoardEffect(part.name, {p.name: Quantity(value, 0.0, p.unit) for p, value in pairs}))
    light = board.with_tilt(
        stiffness=Quantity(STIFF, 0.1, "N*m/rad"), damping=Quantity(DAMP, 0.01, "N*m*s/rad"),
        rest_angle=Quantity(0.01, 0.001, "rad"),
    )  # fmt: skip
    return replace(light, effects=tuple(own))


def recording(board, *, rate=False, drifting=False, **_):
    inertia = board.inertia.value

    def law(angle, speed):
        return (-STIFF * (angle - 0.01) - DAMP * speed - 0.12 * np.tanh(speed / 1e-2)) / inertia

    roll = make_roll(Recipe(law=law, sampling=400, amplitudes=(0.2, -0.15), noise=3e-4, rest=0.01))
    if rate:
        noisy = np.gradient(roll.roll, roll.time)
        roll = replace(roll, rate=noisy, rate_std=np.full(len(noisy), 0.05), measured="rate")
    return Recording.of(replace(roll, zero="drifting") if drifting else roll)


def evidence_of(board, recorded, stood=None):
    stood, compared = JointLaw.from_board(stood or board), compare(recorded, board)
    return Evidence(board=board, releases=recorded.releases, comparison=compared, stood=stood)


CASES = {
    "smooth": (dict(cubic_stiffness=(60.0,), quadratic_damping=(0.004,)), {}),
    "friction": (dict(coulomb=(0.12,), gravity=(1.5,)), {}),
    "stribeck and a stop": (dict(stribeck=(0.05, 0.2, 0.5), end_stop=(0.15, 60.0, 0.1)), {}),
    "memory": (dict(viscoelastic=(4.0, 0.05), hysteresis=(6.0, 0.1)), {}),
    "a support": (dict(second_mode=(0.004, 60.0, 0.1), coulomb=(0.1,)), {}),
    "a sensor": (dict(lowpass=(0.004,), sensor_bias=(0.01,), clock=(1.02,)), {}),
    "no spring": (dict(gravity=(14.0,), coulomb=(0.1,)), {"stiffness": 0.0}),
    "a rate": (dict(coulomb=(0.12,)), {"rate": True}),
    "a zero for each release": (dict(coulomb=(0.12,), sensor_drift=(0.001,)), {"drifting": True}),
}


@pytest.fixture
def opened(chromium, tmp_path):
    def show(play):
        page = Page("play", "")
        page.lead = sliders(play, "")
        (tmp_path / "play.html").write_text(page.render(), encoding="utf-8")
        chromium.open(tmp_path / "play.html")
        return chromium

    return show


def error_of(tab):
    """The page's error once it has been computed."""
    return tab.run(
        "new Promise(done => setTimeout(() => requestAnimationFrame(() => setTimeout(() =>"
        " done(Number(document.getElementById('play').dataset.error)), 250)), 20))"
    )


@pytest.mark.parametrize("name", CASES)
def test_the_page_has_pythons_error(name, pink, opened):
    effects, how = CASES[name]
    board = with_effects(pink, **effects)
    if "stiffness" in how:
        board = board.with_tilt(stiffness=Quantity(how["stiffness"], 0.0, "N*m/rad"))
    recorded = recording(pink, **how)
    play = playground(evidence_of(board, recorded, with_effects(pink)), None)
    tab = opened(play)
    for index, preset in enumerate(play.presets):
        tab.run(f"document.querySelectorAll('.presets button')[{index}].click()")
        expected = compare(recorded, board, law=preset.law)
        assert error_of(tab) == pytest.approx(expected.rmse / expected.noise.std, rel=0.005), preset.label
    assert tab.complaints == []


def test_a_slider_moves_the_law(pink, opened):
    board = with_effects(pink, coulomb=(0.12,))
    recorded = recording(pink)
    play = playground(evidence_of(board, recorded), None)
    tab = opened(play)
    names = tab.run("[...document.querySelectorAll('.sliders label span')].map(e => e.textContent)")
    assert names == ["stiffness k", "damping d", "rest", "dry friction: torque"]
    for place, value in ((0, 1.1 * STIFF), (3, 0.5)):
        tab.run(
            f"(e => {{ e.value = {value}; e.dispatchEvent(new Event('input')); }})"
            f"(document.querySelectorAll('.sliders input')[{place}])"
        )
    law = replace(play.presets[play.settings["begin"]].law, stiffness=1.1 * STIFF)
    law = law.with_effect("coulomb", 0.06)
    expected = compare(recorded, board, law=law)
    assert expected.rmse / expected.noise.std > 3
    assert error_of(tab) == pytest.approx(expected.rmse / expected.noise.std, rel=0.005)
    shown = tab.run("[...document.querySelectorAll('.sliders output')].map(e => e.textContent)")
    assert shown[0] == f"{1.1 * STIFF:.4g} N·m/rad"
    assert shown[3] == "0.06 N·m"


def test_the_effects_of_a_diagnosis_get_sliders_and_a_button(pink):
    board = with_effects(pink)
    values = {"stiffness": STIFF, "damping": DAMP, "rest_angle": 0.01, "coulomb.torque": 0.12}
    best = {"effects": ["coulomb"], "parameters": {key: {"value": value} for key, value in values.items()}}
    diagnosis = LastDiagnosis({"verdict": {}, "best": best, "candidates": [best]}, is_current=True)
    play = playground(evidence_of(board, recording(pink)), diagnosis)
    assert [preset.label for preset in play.presets] == ["as it stood", "+ coulomb"]
    assert play.settings["begin"] == 1
    assert [slider["label"] for slider in play.sliders][3:] == ["dry friction: torque"]
