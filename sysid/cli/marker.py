"""`husky-sysid marker`: a page with markers to print."""

from pathlib import Path

from sysid.cli.console import Common, Output, Printer
from sysid.errors import SysidError


def marker(*, output: Output = Path("marker.pdf"), number: int = 0, common: Common = Common()) -> None:
    """Write an A4 page with an ArUco marker in two sizes, and instructions to fix and film it.

    Args:
        output: PDF, SVG or PNG file to write.
        number: Number of the large marker, 0 to 48; the small one has the next.
    """
    from sysid.video.trackers._marker_page import write_marker_page

    if output.suffix.lower() not in (".pdf", ".svg", ".png"):
        raise SysidError(f"--output {output}: expected a name that ends in .pdf, .svg or .png.")
    if not 0 <= number <= 48:
        raise SysidError(f"--number {number}: expected 0 to 48; the small marker has the next one.")
    printer = Printer(common)
    write_marker_page(output, number)
    printer.say(f"{output}: ArUco 4x4 markers {number} (80 mm) and {number + 1} (40 mm); print at 100 %")
    markers = [{"number": number, "side_mm": 80.0}, {"number": number + 1, "side_mm": 40.0}]
    printer.result({"output": output, "markers": markers})
