"""The mean of policies: weights of checkpoints, and the policy that goes with them."""

import importlib.util
import sys

import numpy as np
import pytest

from sysid.workspace import shipped_data

pytestmark = pytest.mark.train

torch = pytest.importorskip("torch", reason="checkpoints need torch (extra 'train')")
onnx = pytest.importorskip("onnx", reason="policies are averaged with onnx (extra 'train')")

POLICIES = shipped_data() / "policies"


@pytest.fixture(scope="module")
def average():
    spec = importlib.util.spec_from_file_location("average", POLICIES / "average.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def weights_of(path):
    return {t.name: onnx.numpy_helper.to_array(t) for t in onnx.load(str(path)).graph.initializer}


def run(average, monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["average.py", *map(str, arguments)])
    average.main()


@pytest.fixture
def checkpoints(tmp_path):
    """The newest, and another whose actor is larger by half."""
    path = max((POLICIES / "pink").glob("model_*.pt"))
    content = torch.load(path, map_location="cpu", weights_only=True)
    for key, value in content["actor_state_dict"].items():
        if value.is_floating_point():
            content["actor_state_dict"][key] = 1.5 * value
    torch.save(content, tmp_path / "other.pt")
    return path, tmp_path / "other.pt"


def test_the_mean_of_checkpoints_is_written_as_policy(average, tmp_path, monkeypatch):
    """What ships is the mean of the two newest checkpoints, however other the policy is that lends its form."""
    newest = sorted((POLICIES / "pink").glob("model_*.pt"))[-2:]
    files = [tmp_path / "mean.pt", "--policy", POLICIES / "black.onnx", tmp_path / "mean.onnx"]
    run(average, monkeypatch, *newest, *files)
    shipped, mean = weights_of(POLICIES / "pink.onnx"), weights_of(tmp_path / "mean.onnx")
    assert shipped.keys() == mean.keys()
    for name, value in shipped.items():  # the kept checkpoints hold half precision
        np.testing.assert_allclose(mean[name], value, rtol=2e-3, atol=2e-4, err_msg=name)


def test_counts_and_metadata_are_those_of_the_first(average, checkpoints, tmp_path, monkeypatch):
    run(average, monkeypatch, *checkpoints, tmp_path / "mean.pt")
    first, mean = (
        torch.load(path, map_location="cpu", weights_only=True)
        for path in (checkpoints[0], tmp_path / "mean.pt")
    )
    assert mean["iteration"] == first["iteration"]
    critic = "critic_state_dict"  # equal in both, so the mean is the same
    for key, value in first[critic].items():
        torch.testing.assert_close(mean[critic][key], value)


def test_three_policies_weigh_the_same(average, tmp_path, monkeypatch):
    pink, black = POLICIES / "pink.onnx", POLICIES / "black.onnx"
    run(average, monkeypatch, pink, pink, black, tmp_path / "mean.onnx")
    a, b, mean = weights_of(pink), weights_of(black), weights_of(tmp_path / "mean.onnx")
    for name in mean:
        np.testing.assert_allclose(mean[name], (2 * a[name] + b[name]) / 3, rtol=1e-5, atol=1e-6)
