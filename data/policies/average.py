"""Average policies that go back to one checkpoint: weights, normalisers, everything that is a real number.

    python data/policies/average.py A.onnx B.onnx [...] OUT.onnx
    python data/policies/average.py A.pt B.pt [...] OUT.pt [--policy LIKE.onnx OUT.onnx]

Metadata, optimisers and counts are those of the first. With --policy, the mean's actor is also written in the form
of a policy of the same run. Fine-tuned from one ancestor, networks lie in one valley of the loss, and their mean is
often better than each of them (Wortsman et al. 2022, "Model soups").
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np


def main() -> None:
    """Read files of a kind and write their mean."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", type=Path, nargs="+", help="two or more to read, one to write")
    parser.add_argument("--policy", type=Path, nargs=2, metavar=("LIKE", "OUT"))
    options = parser.parse_args()
    *sources, target = options.files
    if len(sources) < 2:
        parser.error("an average takes at least two files, and one to write")
    if target.suffix == ".onnx":
        _average_onnx(sources, target)
        return
    mean = _average_checkpoints(sources, target)
    if options.policy:
        _write_policy(mean, *options.policy)


def _average_onnx(sources: list[Path], target: Path) -> None:
    import onnx
    from onnx import numpy_helper

    result, *others = [onnx.load(str(path)) for path in sources]
    values = [{t.name: numpy_helper.to_array(t) for t in other.graph.initializer} for other in others]
    for tensor in result.graph.initializer:
        own = numpy_helper.to_array(tensor)
        if own.dtype.kind == "f":
            mean = np.mean([own, *(other[tensor.name] for other in values)], axis=0, dtype=np.float64)
            tensor.CopyFrom(numpy_helper.from_array(mean.astype(own.dtype), tensor.name))
    onnx.save(result, str(target))


def _average_checkpoints(sources: list[Path], target: Path) -> dict[str, Any]:
    import torch

    result, *others = [torch.load(path, map_location="cpu", weights_only=True) for path in sources]
    for name, content in result.items():
        if isinstance(content, dict) and "optimi" not in name:
            for key, value in content.items():
                if (
                    isinstance(value, torch.Tensor) and value.is_floating_point()
                ):  # not the curriculum's state
                    total = value.double() + sum(other[name][key].double() for other in others)
                    content[key] = (total / len(sources)).to(value.dtype)
    torch.save(result, target)
    return result


def _write_policy(checkpoint: dict[str, Any], like: Path, target: Path) -> None:
    """Put a checkpoint's actor into a copy of a policy."""
    import onnx
    from onnx import numpy_helper

    policy = onnx.load(str(like))
    weights: dict[str, Any] = checkpoint["actor_state_dict"]
    for tensor in policy.graph.initializer:
        # rsl_rl divides by the deviation and a hundredth; the exporter folds the sum into a constant without a name.
        value = weights[tensor.name] if tensor.name in weights else weights["obs_normalizer._std"] + 0.01
        tensor.CopyFrom(
            numpy_helper.from_array(value.float().numpy().reshape(tuple(tensor.dims)), tensor.name)
        )
    onnx.save(policy, str(target))


if __name__ == "__main__":
    main()
