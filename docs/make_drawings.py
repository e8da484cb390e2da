"""Draw the two pictures of docs/record.md as SVG: a phone on a deck, and a camera before a marker.

python docs/make_drawings.py
"""

from pathlib import Path

PICTURES = Path(__file__).parent / "pictures"
INK, DECK, ACCENT, PAPER = "#333333", "#c98b4a", "#0072b2", "#ffffff"
HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 300" font-family="sans-serif" font-size="15" role="img" '
    'aria-label="{label}"><rect width="720" height="300" fill="#fafafa"/>'
    '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto-start-reverse">'
    f'<path d="M0 0 8 4 0 8z" fill="{ACCENT}"/></marker></defs>'
)


def text(x: float, y: float, words: str, *, anchor: str = "middle", colour: str = INK) -> str:
    """Return words at a place [px]."""
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}" fill="{colour}">{words}</text>'


def box(
    x: float, y: float, width: float, height: float, fill: str, *, radius: float = 4, turn: str = ""
) -> str:
    """Return a rectangle with rounded corners [px]."""
    turned = f' transform="{turn}"' if turn else ""
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="{radius}" fill="{fill}" stroke="{INK}" '
        f'stroke-width="2"{turned}/>'
    )


def arrow(path: str, *, both: bool = False) -> str:
    """Return a line with a tip at its end, or at both."""
    start = ' marker-start="url(#tip)"' if both else ""
    return f'<path d="{path}" fill="none" stroke="{ACCENT}" stroke-width="3" marker-end="url(#tip)"{start}/>'


def wheel(x: float, y: float, radius: float = 17) -> str:
    """Return a wheel [px]."""
    return f'<circle cx="{x}" cy="{y}" r="{radius}" fill="#e8d8c0" stroke="{INK}" stroke-width="2"/>'


def phone() -> str:
    """Return a board from above with a phone on it, and from behind, tilted."""
    parts = [
        HEAD.format(label="A phone taped flat to the deck, its long side along the board"),
        text(215, 30, "from above"),
        box(40, 90, 350, 110, DECK, radius=52),
        '<line x1="20" y1="145" x2="412" y2="145" stroke="#0072b2" stroke-width="2" stroke-dasharray="9 6"/>',
        box(150, 115, 130, 60, PAPER, radius=9),
        box(162, 123, 100, 44, "#dcecf7", radius=3),
        box(172, 106, 12, 78, "#b9c4cc", radius=1), box(246, 106, 12, 78, "#b9c4cc", radius=1),
        text(215, 236, "long side along the board, taped flat"),
        text(215, 258, "the axis of the tilt is dashed", colour=ACCENT),
        text(580, 30, "from behind"),
        wheel(510, 232), wheel(650, 232), box(510, 222, 140, 12, "#b9c4cc"),
        box(570, 176, 20, 46, "#b9c4cc"),
        box(490, 160, 180, 14, DECK, turn="rotate(14 580 167)"),
        box(546, 142, 68, 16, PAPER, turn="rotate(14 580 167)"),
        arrow("M 470 104 A 130 130 0 0 1 690 104", both=True),
        text(580, 282, "wheels held: only the deck tilts"),
        "</svg>",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def camera() -> str:
    """Return a board from the side with a camera behind it, and the picture that the camera takes."""
    squares = ((0, 0), (2, 0), (1, 1), (3, 1), (0, 2), (2, 3), (3, 3), (1, 3))
    cell = 9
    marker = "".join(
        f'<rect x="{562 + cell * i}" y="{108 + cell * j}" width="{cell}" height="{cell}" fill="#ffffff"/>'
        for i, j in squares
    )
    parts = [
        HEAD.format(label="A camera on a tripod behind the board looks along the axis at a marker on the tail"),
        text(225, 30, "from the side"),
        box(190, 178, 230, 14, DECK, radius=7), wheel(235, 218), wheel(375, 218),
        box(229, 192, 12, 14, "#b9c4cc"), box(369, 192, 12, 14, "#b9c4cc"),
        box(186, 138, 8, 42, "#222222", radius=1),
        box(50, 142, 52, 34, "#555555"), box(102, 150, 14, 18, "#222222", radius=2),
        f'<path d="M 76 176 40 236 M 76 176 76 236 M 76 176 112 236" stroke="{INK}" stroke-width="3"/>',
        '<line x1="122" y1="159" x2="180" y2="159" stroke="#0072b2" stroke-width="2" stroke-dasharray="6 5"/>',
        text(76, 262, "tripod"), text(190, 124, "marker"),
        text(300, 262, "level with the deck, along its axis"),
        text(580, 30, "what it sees"),
        box(480, 50, 200, 190, PAPER), wheel(520, 214, 14), wheel(640, 214, 14), box(520, 206, 120, 10, "#b9c4cc"),
        f'<g transform="rotate(-10 580 180)">{box(505, 172, 150, 11, DECK)}'
        f'<rect x="553" y="99" width="54" height="54" fill="#111111"/>{marker}{box(576, 153, 8, 20, "#b9c4cc", radius=1)}</g>',
        text(580, 268, "the marker fills a fifth of the width"),
        "</svg>",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def main() -> None:
    """Write both drawings."""
    for name, drawn in (("record_phone", phone()), ("record_camera", camera())):
        (PICTURES / f"{name}.svg").write_text(drawn, encoding="utf-8")


if __name__ == "__main__":
    main()
