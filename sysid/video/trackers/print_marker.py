"""Writes a printable marker: `python -m sysid.video.trackers.print_marker marker.svg`."""

import sys
from pathlib import Path

from sysid.errors import HuskyError
from sysid.files import write_atomically
from sysid.video.trackers.marker import marker_svg


def main(arguments: list[str]) -> int:
    """Write marker number 0, 80 mm wide, or as the second and third argument say."""
    if not 1 <= len(arguments) <= 3:
        usage = "usage: python -m sysid.video.trackers.print_marker FILE.svg [NUMBER [SIDE_MM]]"
        print(usage, file=sys.stderr)  # noqa: T201  a script
        return 2
    try:
        number, side = (
            int((*arguments, "0")[1]) if len(arguments) > 1 else 0,
            float(arguments[2]) if len(arguments) > 2 else 80.0,
        )
        if not 0 <= number < 50 or not 10 <= side <= 1000:
            raise ValueError
        write_atomically(Path(arguments[0]), marker_svg(number, side))
    except ValueError:
        print("error: NUMBER is 0 to 49, SIDE_MM 10 to 1000.", file=sys.stderr)  # noqa: T201
        return 2
    except HuskyError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return 1
    print(f"{arguments[0]}: ArUco 4x4 marker {number}, {side:g} mm; print it at 100 %")  # noqa: T201
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
