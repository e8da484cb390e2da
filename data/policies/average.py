"""Average two policies that go back to the same checkpoint: weights, normalisers, everything that is a real number.

    python data/policies/average.py A.onnx B.onnx OUT.onnx
    python data/policies/average.py A.pt B.pt OUT.pt

Metadata, optimisers and counts are those of A. Fine-tuned from one ancestor, networks lie in one valley of
the loss, and their mean is often better than either (Wortsman et al. 2022, "Model soups").
"""

import sys
from pathlib import Path
from typing import Any


def main() -> None:
    """Read two files of a kind and write their mean."""
    first, second, target = map(Path, sys.argv[1:])
    (_average_onnx if target.suffix == ".onnx" else _average_checkpoints)(first, second, target)


def _average_onnx(first: Path, second: Path, target: Path) -> None:
    import onnx
    from onnx import numpy_helper

    result, other = onnx.load(str(first)), onnx.load(str(second))
    others = {tensor.name: numpy_helper.to_array(tensor) for tensor in other.graph.initializer}
    for tensor in result.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if values.dtype.kind == "f":
            mean = ((values + others[tensor.name]) / 2).astype(values.dtype)
            tensor.CopyFrom(numpy_helper.from_array(mean, tensor.name))
    onnx.save(result, str(target))


def _average_checkpoints(first: Path, second: Path, target: Path) -> None:
    import torch

    result: dict[str, Any] = torch.load(first, map_location="cpu", weights_only=True)
    other: dict[str, Any] = torch.load(second, map_location="cpu", weights_only=True)
    for name, content in result.items():
        if isinstance(content, dict) and "optimi" not in name:
            for key, value in content.items():
                if value.is_floating_point():
                    content[key] = (value + other[name][key]) / 2
    torch.save(result, target)


if __name__ == "__main__":
    main()
