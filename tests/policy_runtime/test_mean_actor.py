"""The mean of an actor's weights on their way, which is what a run exports."""

import numpy as np
import pytest

from sysid.workspace import shipped_data

pytestmark = pytest.mark.train

torch = pytest.importorskip("torch", reason="learners need torch (extra 'train')")


class Actor(torch.nn.Module):
    """One weight, one statistic of a normaliser, one count."""

    def __init__(self):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(1))
        self.register_buffer("deviation", torch.zeros(1))
        self.register_buffer("count", torch.tensor(0))

    def become(self, value):
        with torch.inference_mode():
            self.weight.fill_(value)
            self.deviation.fill_(2 * value)
            self.count.fill_(int(value))


def mean_after(values, begun=0):
    from policy_runtime.learning.amp import mean_actor

    actor = Actor()
    mean = mean_actor(actor)
    mean.n_averaged.fill_(begun)
    for value in values:
        actor.become(value)
        with torch.inference_mode():
            mean.update_parameters(actor)
    return mean.module


def test_iterations_weigh_by_a_power_of_their_number():
    from policy_runtime.learning.amp import ETA

    values = np.cumsum(np.random.default_rng(1).normal(size=400)) + 50
    mean = mean_after(values)
    # Iteration t is taken in with (η + 1) / (t + η), and all before it shrink by the rest.
    share = (ETA + 1) / (np.arange(1, 401) + ETA)
    weights = share * np.append(np.cumprod((1 - share)[::-1])[-2::-1], 1.0)
    assert weights.sum() == pytest.approx(1.0)
    assert mean.weight.item() == pytest.approx(weights @ values, rel=1e-4)
    assert mean.deviation.item() == pytest.approx(2 * weights @ values, rel=1e-4)
    assert mean.count.item() == int(values[-1])
    age = 400 - weights @ np.arange(1, 401)
    assert age / 400 == pytest.approx(1 / (ETA + 2), abs=0.005)


@pytest.mark.parametrize("board", ["pink", "black", "pink-strides", "black-strides"])
def test_what_ships_is_the_mean_in_its_newest_weights(board):
    onnx = pytest.importorskip("onnx", reason="policies are read with onnx (extra 'train')")
    policies = shipped_data() / "policies"
    newest = max((policies / board).glob("model_*.pt"), key=lambda path: int(path.stem.split("_")[1]))
    mean = torch.load(newest, map_location="cpu", weights_only=True)["mean_actor"]
    shipped = {t.name: t for t in onnx.load(str(policies / f"{board}.onnx")).graph.initializer}
    compared = [name for name in shipped if f"module.{name}" in mean]
    assert len(compared) >= 8
    for name in compared:  # the kept weights hold half precision
        kept = mean[f"module.{name}"].float().numpy()
        np.testing.assert_allclose(
            onnx.numpy_helper.to_array(shipped[name]), kept, rtol=2e-3, atol=2e-4, err_msg=name
        )
