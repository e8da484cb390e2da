"""Take the weighted mean of two policies (ONNX), or of two checkpoints, of one training.

    python data/policies/mean_weights.py ONE OTHER SHARE OUT

SHARE, 0 to 1, is how much OTHER counts. What a stage of training gave and what it took are often both kept between the two
(Wortsman et al. 2022, "Robust fine-tuning of zero-shot models"). All but the weights is that of OTHER.
"""

import sys
from pathlib import Path
from typing import Any


def main() -> None:
    """Read two files and write their mean."""
    one, other, share, out = sys.argv[1:]
    mean_of = _mean_policy if Path(other).suffix == ".onnx" else _mean_checkpoint
    mean_of(Path(one), Path(other), float(share), Path(out))


def _mean_policy(one: Path, other: Path, share: float, out: Path) -> None:
    import onnx
    from onnx import numpy_helper

    first = {tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load(one).graph.initializer}
    model = onnx.load(other)
    for tensor in model.graph.initializer:
        mean = (1 - share) * first[tensor.name] + share * numpy_helper.to_array(tensor)
        tensor.CopyFrom(numpy_helper.from_array(mean, tensor.name))
    onnx.save(model, out)


def _mean_checkpoint(one: Path, other: Path, share: float, out: Path) -> None:
    import torch

    first, kept = (torch.load(path, map_location="cpu", weights_only=True) for path in (one, other))

    def mean(before: Any, after: Any) -> Any:
        is_real = isinstance(after, torch.Tensor) and after.is_floating_point()
        return ((1 - share) * before.float() + share * after.float()).to(after.dtype) if is_real else after

    for network in ("actor_state_dict", "critic_state_dict", "discriminator", "mean_actor"):
        kept[network] = {name: mean(first[network][name], value) for name, value in kept[network].items()}
    torch.save(kept, out)


if __name__ == "__main__":
    main()
