"""The run folder, boards from the posterior, the style extension, and a short training on the CPU."""

import json
import math
import os
import shutil
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import training  # noqa: F401  skips without the training stack
from command_line import called

from policy_runtime.learning.run_folder import LearnOptions, RunConfig, RunFolder
from sim.skate.cycle.start import Start
from sim.skate.options import SkateOptions
from sim.skate.world.posterior import FIELDS, Spread, board_draws, draw_boards
from sysid.board import BoardEffect, load_board
from sysid.effects import effect
from sysid.errors import QualityGateError, SysidError
from sysid.quantity import Quantity
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train

PINK = shipped_data() / "boards" / "pink.toml"


def run(*command):
    environment = os.environ | {"OMP_NUM_THREADS": "1", "MUJOCO_GL": "disable", "MJLAB_WARP_QUIET": "1"}
    subprocess.run(
        [sys.executable, "-m", *command], check=True, env=environment, cwd=Path(__file__).parents[2]
    )


@pytest.fixture
def started(tmp_path):
    folder = RunFolder(tmp_path / "run")
    config = RunConfig(
        task=SkateOptions(boards=2), learn=LearnOptions(environments=16, iterations=3, save_every=2)
    )
    folder.begin(config, PINK)
    return folder


def test_options_survive_the_file_infinity_included(tmp_path):
    task = SkateOptions(change=math.inf, start=Start(dismounting=0.5), terrain="steps")
    config = RunConfig(task=task, learn=LearnOptions(hidden=(64, 32), seed=7))
    folder = RunFolder(tmp_path)
    folder.write_config(config)
    assert folder.read_config() == config


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'terrain = "flat"',
            'terrain = "stairs"',
            "terrain is 'stairs'; expected one of flat, slopes, steps",
        ),
        ("seed = 1", "sead = 1", "unknown option 'sead'.*Did you mean 'seed'"),
    ],
)
def test_a_bad_option_is_named(started, old, new, message):
    started.config.write_text(started.config.read_text().replace(old, new))
    with pytest.raises(SysidError, match=message):
        started.read_config()


def test_a_line_cut_short_by_a_kill_is_left_out(started):
    started.curves.write_text('{"iteration": 1}\n{"iteration": 2}\n{"itera')
    assert [row["iteration"] for row in started.read_curves()] == [1, 2]
    started.add_to_curves({"iteration": 3})
    started.add_to_curves({"iteration": 4})
    assert [row["iteration"] for row in started.read_curves()] == [1, 2, 3, 4]


def test_a_run_can_begin_with_another_ones_checkpoint(tmp_path):
    checkpoint = tmp_path / "model_7.pt"
    checkpoint.write_bytes(b"weights")
    folder = RunFolder(tmp_path / "next")
    folder.begin(RunConfig(), PINK, checkpoint)
    assert folder.checkpoints() == [folder.checkpoint(7)]
    assert folder.checkpoint(7).read_bytes() == b"weights"
    assert len(json.loads(folder.origin.read_text())["start_from"]["sha256"]) == 64
    with pytest.raises(SysidError, match=r"no checkpoint; expected a file model_N\.pt"):
        RunFolder(tmp_path / "other").begin(RunConfig(), PINK, tmp_path / "policy.onnx")


def resumed(folder, *arguments):
    target = ("--resume", folder.path, "--workspace", folder.path.parent)
    return called("train", "--board", "pink", "--force", *target, *arguments)


def with_checkpoint(folder, iteration):
    """Put a checkpoint's name there; what is in it is read by nobody here."""
    folder.checkpoint(iteration).parent.mkdir(exist_ok=True)
    folder.checkpoint(iteration).touch()
    folder.add_to_curves({"iteration": iteration, "samples": 1, "survival": 1, "speed_error": 1})


@pytest.fixture
def begun(tmp_path, monkeypatch):
    """A run that began on the CPU, and what the command would start: the number of GPUs of each start."""
    from policy_runtime.learning import curves
    from sysid.cli import train as command

    starts = []
    monkeypatch.setattr(curves, "draw_curves", lambda rows, picture, title: picture)
    monkeypatch.setattr(command, "_iterations_of", lambda *given: None)
    monkeypatch.setattr(command, "_run", lambda folder, machines, *given: starts.append(machines.gpus))
    folder = RunFolder(tmp_path / "run")
    folder.begin(RunConfig(learn=LearnOptions(environments=16, iterations=3)), PINK, gpus=0)
    return folder, starts


def test_a_run_goes_on_where_it_began_and_beyond_its_end_with_a_new_total(begun, capsys):
    folder, starts = begun
    with pytest.raises(SysidError, match="holds no checkpoint to go on from"):
        resumed(folder)
    with_checkpoint(folder, 2)
    assert resumed(folder) == 0
    assert starts == [0]
    with_checkpoint(folder, 3)
    assert resumed(folder) == 0
    assert starts == [0]
    assert "all of its 3 iterations are done; go on with a larger --iterations" in capsys.readouterr().err
    assert resumed(folder, "--iterations", "5", "--gpus", "1") == 0
    assert starts == [0, 1]
    assert folder.read_config().learn.iterations == 5
    with pytest.raises(SysidError, match="has done 3 already"):
        resumed(folder, "--iterations", "2")
    assert folder.read_config().learn.iterations == 5


@pytest.mark.parametrize(
    "option",
    [
        "--minutes=0",
        "--set=mount_steps=-3",
        "--set=bezier_order=0",
        "--set=pose_offset=high",
        "--set=pushing=jump",
        "--set=puhsing=amp",
    ],
)
def test_an_impossible_option_starts_nothing(begun, tmp_path, option):
    from cyclopts import ValidationError

    with pytest.raises((ValidationError, SysidError), match=option.split("=")[0]):
        called("train", "--board", "pink", "--force", "--workspace", tmp_path, option)
    assert begun[1] == []
    assert not (tmp_path / "reports").exists()


def test_any_option_of_a_run_is_set_by_its_name():
    config = RunConfig()
    for text in (
        "pushing=tracking",
        "tilt_guidance=false",
        "entropy=0",
        "pose_offset=-0.05",
        "foot_place=[-0.1, 0.0]",
    ):
        config = config.changed(text)
    assert (config.task.pushing, config.task.tilt_guidance) == ("tracking", False)
    assert (config.learn.entropy, config.task.foot_place) == (0.0, (-0.1, 0.0))
    assert config.task.pose_offset == -0.05


def test_a_run_that_goes_on_has_its_own_board(begun, tmp_path):
    folder, starts = begun
    with_checkpoint(folder, 2)
    where = ("--resume", folder.path, "--workspace", tmp_path)
    assert called("train", *where) == 0
    with pytest.raises(SysidError, match="a run for board 'pink', not 'black'"):
        called("train", "--board", "black", *where)
    with pytest.raises(SysidError, match="no training run there"):
        called("train", "--resume", tmp_path)
    with pytest.raises(SysidError, match="--board"):
        called("train")
    assert starts == [0]


def test_a_run_that_goes_on_takes_no_other_options(begun):
    folder, starts = begun
    with_checkpoint(folder, 2)
    with pytest.raises(SysidError, match="--resume goes on with the run's own options"):
        resumed(folder, "--set", "pose_offset=0.3")
    assert starts == []


def drawn(draws, field, element):
    """Return the numbers of one element, shape (m, ...)."""
    return draws.fields[field][:, draws.elements[FIELDS[field]].index(element)]


def test_boards_are_drawn_about_the_record_and_reach_the_simulator():
    cubic = BoardEffect("cubic-stiffness", {"coefficient": Quantity(50.0, 5.0, "N*m/rad^3")})
    board = replace(load_board(PINK), effects=(cubic,))
    spread = Spread()
    boards = draw_boards(board, 200, spread, np.random.default_rng(1))
    draws = board_draws(boards[:20], 0.005)
    joint = "board_tilt_joint"
    np.testing.assert_allclose(drawn(draws, "jnt_stiffness", joint), [b.stiffness for b in boards[:20]])
    steered = np.array([b.inertia.value for b in boards[:20]]) - drawn(draws, "body_inertia", "deck")[:, 0]
    slope = np.tan([b.geometry["rake"].value for b in boards[:20]])
    # The rest of the roll inertia is of the parts that steer, by tan² of the rake.
    assert np.ptp(steered / slope**2) < 1e-12
    coupling = drawn(draws, "eq_data", draws.elements["equality"][0])
    np.testing.assert_allclose(coupling[:, 1], slope, rtol=2e-3)  # σ ≈ tan λ · roll
    assert 0 <= steered[0] < 0.1 * board.inertia.value
    cubes = [b.effects[0].parameters["coefficient"].value for b in boards[:20]]
    np.testing.assert_allclose(drawn(draws, "jnt_stiffnesspoly", joint)[:, 1], cubes)
    stiffness = np.log([b.stiffness / board.stiffness for b in boards])
    assert stiffness.mean() == pytest.approx(0.0, abs=0.01)
    assert stiffness.std() == pytest.approx(spread.relative, rel=0.2)
    assert np.abs(stiffness).max() <= spread.truncate * spread.relative + 1e-3


def test_friction_that_is_hardly_known_is_never_negative_and_a_stop_reaches_the_worlds():
    """Every parameter known to 100 % only: dry friction, and an end stop, which is a tendon."""
    parts = tuple(
        BoardEffect(name, {p.name: Quantity(0.1, 0.1, p.unit) for p in effect(name).parameters})
        for name in ("coulomb", "end-stop")
    )
    boards = draw_boards(replace(load_board(PINK), effects=parts), 64, Spread(), np.random.default_rng(2))
    draws = board_draws(boards, 0.005)
    assert (drawn(draws, "dof_frictionloss", "board_tilt_joint") > 0).all()
    (stop,) = draws.elements["tendon"]
    assert (drawn(draws, "tendon_stiffness", stop) > 0).all()
    slack = drawn(draws, "tendon_lengthspring", stop)
    assert (slack[:, 1] > slack[:, 0]).all()
    assert np.ptp(slack[:, 1]) > 0.02


def test_a_board_that_has_not_passed_is_refused(tmp_path):
    text = PINK.read_text()
    (tmp_path / "data" / "boards").mkdir(parents=True)
    (tmp_path / "data" / "boards" / "new.toml").write_text(
        text.split("[check]")[0].replace('name = "pink"', 'name = "new"')
    )
    with pytest.raises(QualityGateError, match=r"'new' has not passed .*--force") as refusal:
        called("train", "--board", "new", "--workspace", tmp_path)
    assert refusal.value.exit_code == 3
    assert not (tmp_path / "reports").exists()


def test_style_is_one_for_reference_and_zero_far_off():
    import torch

    from policy_runtime.learning.amp import style_value

    np.testing.assert_allclose(style_value(torch.tensor([1.0, -1.0, 3.0, 5.0, 0.0])), [1, 0, 0, 0, 0.75])


def test_the_running_normaliser_is_the_statistics_of_all_it_saw():
    import torch

    from policy_runtime.learning.amp import RunningNormaliser

    data = torch.tensor(np.random.default_rng(0).normal(3.0, 2.0, size=(300, 2)), dtype=torch.float)
    normaliser = RunningNormaliser(2)
    for part in data.split([50, 150, 100]):
        normaliser.update(part)
    np.testing.assert_allclose(normaliser.mean, data.mean(0), rtol=1e-4)
    np.testing.assert_allclose(normaliser.variance, data.var(0, unbiased=False), rtol=1e-4)


def test_the_discriminator_learns_to_tell_two_styles_apart():
    import torch

    from policy_runtime.learning.amp import Discriminator

    torch.manual_seed(0)
    reference, policy = torch.randn(512, 6) + 1.0, torch.randn(512, 6) - 1.0
    net = Discriminator(6, (32, 32))
    net.normaliser.update(torch.cat((reference, policy)))
    optimiser = torch.optim.Adam(net.parameters(), lr=3e-3)
    for _ in range(150):
        optimiser.zero_grad()
        net.loss(reference, policy, penalty=0.5).backward()
        optimiser.step()
    assert net(reference).mean() > 0.5
    assert net(policy).mean() < -0.5


@pytest.mark.slow
def test_training_runs_resumes_and_exports_a_policy_that_answers(started):
    import onnx
    import onnxruntime as ort
    import torch

    run("policy_runtime.train", started.path, "--device", "cpu")
    assert [path.name for path in started.checkpoints()] == ["model_2.pt", "model_3.pt"]
    before = started.policy.read_bytes()
    run("policy_runtime.train", started.path, "--device", "cpu", "--iterations", "4")
    rows = started.read_curves()
    assert [row["iteration"] for row in rows] == [1, 2, 3, 4]
    assert all(math.isfinite(value) for row in rows for value in row.values())
    assert started.policy.read_bytes() != before
    session = ort.InferenceSession(str(started.policy), providers=["CPUExecutionProvider"])
    answer = session.run(["actions"], {"obs": np.zeros((1, 390), dtype=np.float32)})[0]
    assert answer.shape == (1, 23)
    assert session.get_modelmeta().custom_metadata_map["board"] == "pink"
    kept = torch.load(started.checkpoint(4), weights_only=True)
    exported = {
        t.name: onnx.numpy_helper.to_array(t) for t in onnx.load(str(started.policy)).graph.initializer
    }
    name = "mlp.0.weight"
    assert np.array_equal(exported[name], kept["mean_actor"][f"module.{name}"])
    assert not np.array_equal(exported[name], kept["actor_state_dict"][name])


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Two iterations of eight worlds, with a checkpoint after each."""
    from policy_runtime.train import train

    folder = RunFolder(tmp_path_factory.mktemp("trained") / "run")
    learn = LearnOptions(environments=8, steps=6, iterations=2, save_every=1, hidden=(32, 16))
    folder.begin(RunConfig(task=SkateOptions(boards=2), learn=learn), PINK)
    with warnings.catch_warnings(action="ignore"):  # the training stack's own
        assert train(folder, device="cpu") == 2
    return folder


def copied(folder, tmp_path, name):
    shutil.copytree(folder.path, tmp_path / name)
    return RunFolder(tmp_path / name)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_run_goes_on_bit_for_bit_at_its_level_of_difficulty(trained, tmp_path):
    import torch

    from policy_runtime.learning.curriculum import LONGEST, Level
    from policy_runtime.train import build, build_curriculum, join_processes, restore, train

    process, config = join_processes("cpu"), trained.read_config()
    kept = torch.load(trained.checkpoint(2), weights_only=True)
    env, learner = build(trained, config, process)
    done, level = restore(trained, config, env, learner, process)
    assert (done.iterations, done.samples) == (2, 2 * 8 * 6) == (kept["iteration"], kept["samples"])
    learned = learner.save()
    torch.testing.assert_close(learned, {key: kept[key] for key in learned}, rtol=0, atol=0)
    rows = trained.read_curves()
    assert (rows[0]["patience"], rows[0]["entropy_weight"]) == (LONGEST, 0.005)
    expected = Level(patience=LONGEST)
    for row in rows:
        expected = expected.after(row["falls_per_minute"], own=20)
    assert level == expected
    build_curriculum(config, env, learner, level).set(Level(patience=50.0, strength=0.2, ends=30.0))
    worlds = env.unwrapped
    assert float(worlds.termination_manager.get_term_cfg("wrong_stance").params["patience"]) == 50.0
    assert worlds.event_manager.get_term_cfg("worlds").func.strength == 0.2
    env.close()
    ends = []  # of two runs that go on from it
    for name in ("first", "second"):
        folder = copied(trained, tmp_path, name)
        assert folder.read_config() == config
        assert train(folder, device="cpu", iterations=3) == 3
        ends.append(torch.load(folder.checkpoint(3), weights_only=True))
        assert [row["samples"] for row in folder.read_curves()] == [48, 96, 144]
    torch.testing.assert_close(*ends, rtol=0, atol=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "kind"),
    [("--resume", "cut"), ("--resume", "foreign"), ("--from", "object"), ("--from", "missing")],
)
def test_a_broken_checkpoint_is_said_in_one_line(trained, tmp_path, kind, option):
    import torch

    folder = copied(trained, tmp_path, "run")
    path = folder.checkpoint(2)
    content = path.read_bytes()
    if kind == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif kind == "foreign":
        torch.save({"model_state_dict": {}}, path)
    elif kind == "object":
        torch.save(SkateOptions(), path)
    else:
        path.unlink()
    target = ["--resume", str(folder.path)] if option == "--resume" else ["--from", str(path)]
    with pytest.raises(SysidError) as refusal:
        called("train", "--board", "pink", "--gpus", "0", "--force", "--workspace", tmp_path, *target)
    message = str(refusal.value)
    assert "\n" not in message
    assert message.startswith(f"{path}: ")
    words = {"foreign": "'actor_state_dict' is not in it", "missing": "cannot be read"}
    assert words.get(kind, "not a whole checkpoint") in message
    assert not (tmp_path / "reports").exists()


@pytest.mark.slow
def test_two_processes_hold_the_same_weights_normalisers_and_discriminator(started):
    import torch

    torchrun = ("torch.distributed.run", "--standalone", "--nproc-per-node=2")
    run(*torchrun, Path(__file__).parents[1] / "support" / "keeps_all.py", started.path)
    first, second = (torch.load(started.path / f"process_{rank}.pt", weights_only=True) for rank in (0, 1))
    for part in ("actor_state_dict", "critic_state_dict", "discriminator", "mean_actor"):
        assert first[part].keys() == second[part].keys()
        for name, value in first[part].items():
            torch.testing.assert_close(value, second[part][name], rtol=0, atol=1e-6, msg=f"{part} {name}")
