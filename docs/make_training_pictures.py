"""Draw the learning curves of the policies with strides from the numbers beside them.

python docs/make_training_pictures.py
"""

import csv
from pathlib import Path

from policy_runtime.learning.curves import draw_curves

REPOSITORY = Path(__file__).parents[1]


def main() -> None:
    """Draw one picture a policy."""
    for name in ("pink-strides", "black-strides"):
        with (REPOSITORY / "data" / "policies" / f"{name}_curves.csv").open(encoding="utf-8") as file:
            rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        picture = REPOSITORY / "docs" / "pictures" / f"training-{name}.png"
        print(draw_curves(rows, picture, name))


if __name__ == "__main__":
    main()
