"""What `fuzz_commands.py` gives to commands: logs with a known truth, damaged logs and records, hostile policies, odd options."""

import bz2
import gzip
import io
import lzma
import math
import struct
import typing
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np

from sysid.board import Board, board_to_toml
from sysid.effects import catalogue
from sysid.quantity import Quantity
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor

LANGUAGES = (
    ("time", "angle"), ("Zeit", "Winkel"), ("tempo", "angolo"), ("temps", "angle"), ("tiempo", "ángulo"), ("время", "угол"),
    ("时间", "角度"), ("czas", "kąt"),
)  # fmt: skip
"""Words for time and angle."""
SHARES = {"angle": 0.3, "angle-deg": 0.2, "gyro": 0.15, "imu": 0.15, "phyphox": 0.1, "sensor-logger": 0.1}
"""Of the dialects of a joint that turns."""
SHIPPED = Path(__file__).parents[1] / "data"
Random = np.random.Generator


@dataclass(frozen=True)
class Truth:
    """The linear joint that a log was made with."""

    stiffness: float
    """[N*m/rad]."""
    damping: float
    """[N*m*s/rad]."""


def drawn_board(rng: Random) -> Board:
    """Draw a linear board; its inertia is known exactly, so that the intervals are the decay's own."""
    pink = Board.load(SHIPPED / "boards/pink.toml")
    omega = 2 * math.pi * math.exp(rng.uniform(math.log(0.8), math.log(12)))
    zeta = math.exp(rng.uniform(-3.9, -0.6))
    inertia = math.exp(rng.uniform(math.log(2e-3), math.log(0.5)))
    return replace(
        pink,
        name="mine",
        inertia=Quantity(inertia, 0.0, "kg*m^2", "known exactly"),
        decay={},
        published={},
        tilt={
            **pink.tilt,
            "stiffness": Quantity(inertia * omega**2, 0.05 * inertia * omega**2, "N*m/rad"),
            "damping": Quantity(2 * zeta * omega * inertia, 0.1 * zeta * omega * inertia, "N*m*s/rad"),
        },
    )  # fmt: skip


def log_with_truth(rng: Random, folder: Path, board: Board, *, quick: bool = False) -> tuple[Path, Truth]:
    """Write what a sensor reads of a board that is let go a few times; nothing is wrong with the log.

    Args:
        rng: Draws sensor, rate, noise and how the file is written.
        folder: Where to.
        board: Moves by its record.
        quick: Make it short.
    """
    omega = math.sqrt(board.stiffness / board.inertia.value)
    zeta = board.damping / (2 * board.inertia.value * omega)
    rate = float(np.clip(omega / (2 * math.pi) * rng.uniform(15, 60), 50, 1000))
    duration = float(np.clip(rng.uniform(3.5, 6) / (zeta * omega), 1.0, 6.0 if quick else 25.0))
    count = 2 if quick else int(rng.integers(2, 5))
    angles = tuple(float(a) for a in rng.uniform(0.06, 0.19, count) * rng.choice([-1, 1], count))
    dialect = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    sensor = Sensor(
        noise=math.radians(math.exp(rng.uniform(math.log(0.02), math.log(0.3)))),
        quantisation=math.radians(rng.choice([0.0, 0.0, 0.01, 0.05])),
        gyro_bias=rng.normal(0, 0.01),
    )
    log = synthesise(
        board, {}, SynthOptions(
            angles=angles, rate=rate, duration=duration, seed=int(rng.integers(1 << 31)), dialect=dialect, sensor=sensor,
            jitter=float(rng.choice([0.0, 0.0, 0.05])), dropout=float(rng.choice([0.0, 0.0, 0.03])),
        ),
    )  # fmt: skip
    path = folder / ("log.zip" if dialect in ("phyphox", "sensor-logger") else "log.csv")
    truth = Truth(board.stiffness, board.damping)
    if dialect.startswith("angle"):
        path.write_bytes(_dressed(rng, log.time, log.channels[:, 0]))
    else:
        log.save(path)
        path.with_suffix(".truth.json").unlink()
    return path, truth


def _dressed(rng: Random, time: Any, angle: Any) -> bytes:
    """Return an angle log as one of the many files that people have; `angle` is in rad."""
    unit, size = (("rad", 1.0), ("deg", math.degrees(1)), ("mrad", 1e3))[rng.integers(3)]
    clock, tick = (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9))[rng.integers(4)]
    begin = rng.choice([0.0, 13.84, 1.7e9])
    stamps = [f"{t:.9f}" if clock == "s" else str(round(t * tick)) for t in (begin + time)]
    words = LANGUAGES[rng.integers(len(LANGUAGES))]
    names = (f"{words[0]}_{clock}", f"{words[0]} ({clock})", f"t [{clock}]")[rng.integers(3)], (
        f"roll_{unit}", f"{words[1]} ({unit})", f"{words[1]} [{unit}]")[rng.integers(3)]  # fmt: skip
    sep, decimal = ((",", "."), (";", ","), ("\t", "."), (";", "."), (" ", "."))[rng.integers(5)]
    if sep == " ":
        names = (f"time_{clock}", f"roll_{unit}")
    cells = [[s, f"{a:.9g}"] for s, a in zip(stamps, angle * size, strict=True)]
    if rng.random() < 0.2:  # three stand-ins for no measurement
        for row in rng.choice(len(cells), 3, replace=False):
            cells[row][1] = "-9999"
    if rng.random() < 0.1:
        cells.reverse()  # newest row first
    if rng.random() < 0.2:  # what a motor's logger writes beside the motion
        names = (*names, *(f"{name}{'' if sep == ' ' else ' (A)'}" for name in ("battery",)), "temperature")
        cells = [[*row, "11.7", f"{30 + rng.normal(0, 0.1):.2f}"] for row in cells]
    if rng.random() < 0.1:  # a bob that a video tracker followed
        x, y = 0.3 + 0.42 * np.sin(angle), 0.1 - 0.42 * np.cos(angle)
        names, unit = (names[0], "x", "y"), "m"
        cells = [[s, f"{a:.6g}", f"{b:.6g}"] for s, a, b in zip(stamps, x, y, strict=True)]
    lines = [sep.join(names), *(sep.join(cell.replace(".", decimal) for cell in row) for row in cells)]
    text = ("\n", "\r\n")[rng.integers(2)].join(lines) + "\n"
    data = text.encode(("utf-8", "utf-8-sig", "utf-16")[rng.integers(3)])
    pack = (bytes, gzip.compress, bz2.compress, lzma.compress)[rng.choice(4, p=[0.85, 0.05, 0.05, 0.05])]
    return pack(data)


# Damage

MAGIC = (
    b"PAR1", b"PK\x03\x04", b"\x89MCAP0\r\n", b"MATLAB 5.0 MAT-file", b"\x89HDF\r\n\x1a\n", b"\x1f\x8b\x08", b"BZh9",
    b"\xfd7zXZ\0", b"#ROSBAG V2.0\n", b"SQLite format 3\0", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"RIFF\0\0\0\0AVI ",
    b"\0\0\0\x18ftypmp42", b"\x1aE\xdf\xa3", b"\x89PNG\r\n\x1a\n", b"GIF89a", b"\0" * 16, b"\xff\xfe", b"",
)  # fmt: skip
CELLS = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e-308", "", "NaN", "x", "-9999", "0x10", "1,5", "1.5.2", "−3", "9" * 400,
    '"', "'", "\0", "=1+1", "../../x", "31.03.2024", "12:00:00 PM", "1_000", "٣", "True", "[1,2]",
)  # fmt: skip


def damaged(rng: Random, data: bytes) -> bytes:
    """Return the bytes of a file after one to three accidents."""
    for _ in range(int(rng.integers(1, 4))):
        data = ACCIDENTS[rng.integers(len(ACCIDENTS))](rng, data)
    return data


def _flipped(rng: Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for place in rng.integers(0, max(len(changed), 1), int(rng.choice([1, 5, 100]))) if data else ():
        changed[place] = int(rng.integers(256))
    return bytes(changed)


def _cut(rng: Random, data: bytes) -> bytes:
    begin, end = sorted(rng.integers(0, len(data) + 1, 2))
    return (data[:end], data[begin:], data[:begin] + data[end:], data[begin:end])[rng.integers(4)]


def _rows(change: Callable[[Random, list[bytes]], list[bytes]]) -> Callable[[Random, bytes], bytes]:
    return lambda rng, data: b"\n".join(change(rng, data.split(b"\n")))


def _cells(rng: Random, rows: list[bytes]) -> list[bytes]:
    """Write odd things into a share of the cells of a column."""
    share, cell = rng.choice([0.001, 0.01, 0.3, 1.0]), str(rng.choice(CELLS)).encode()
    sep = next((s for s in (b";", b"\t", b",") if s in rows[0]), b",")
    result: list[bytes] = []
    column = int(rng.integers(0, 3))
    for row in rows:
        parts = row.split(sep)
        if column < len(parts) and rng.random() < share:
            parts[column] = cell
        result.append(sep.join(parts))
    return result


def _shuffled(rng: Random, rows: list[bytes]) -> list[bytes]:
    return [rows[0], *(rows[i] for i in 1 + rng.permutation(len(rows) - 1))]


def _repeated(rng: Random, rows: list[bytes]) -> list[bytes]:
    begin, end = sorted(rng.integers(0, len(rows) + 1, 2))
    return rows[:end] + rows[begin:end] * int(rng.integers(1, 3)) + rows[end:]


def _wide(rng: Random, rows: list[bytes]) -> list[bytes]:
    extra = b",".join([b"7"] * int(rng.choice([3, 300, 30_000])))
    return [row + b"," + extra if i < 40 else row for i, row in enumerate(rows)]


def _headed(rng: Random, rows: list[bytes]) -> list[bytes]:
    heads = (
        b"", b"a,b", b"roll,roll", b"time,time,time", b"time (fortnights),roll (cubits)", b"#", b"gyroX,gyroY,gyroZ",
        b"ax,ay,az", b"time_s,roll_rad,roll_std_rad", b"\xff\xfe\0", b"q0,q1,q2,q3", b"time_ms,gx (rpm)",
    )  # fmt: skip
    return [heads[rng.integers(len(heads))], *rows[int(rng.integers(2)) :]]


def _zipped(rng: Random, data: bytes) -> bytes:
    """Pack a file as a phone's export, under names that lead elsewhere, as often as not as a bomb."""
    buffer = io.BytesIO()
    names = ("Gyroscope.csv", "../../Gyroscope.csv", "/tmp/Gyroscope.csv", "a/../Accelerometer.csv",
             "Gyroscope.csv\0x")  # fmt: skip
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(str(rng.choice(names))), data)
        if rng.random() < 0.3:
            archive.writestr("Accelerometer.csv", b"0" * (64 << 20))
        if rng.random() < 0.2:
            for number in range(12_000):
                archive.writestr(f"Gyroscope{number}.csv", b"")
    return buffer.getvalue()


def _encoded(rng: Random, data: bytes) -> bytes:
    text = data.decode("latin-1")
    return text.encode(str(rng.choice(["utf-16", "utf-32", "utf-7", "utf-8-sig"])))


ACCIDENTS: tuple[Callable[[Random, bytes], bytes], ...] = (
    _flipped,
    _cut,
    _rows(_cells),
    _rows(_shuffled),
    _rows(_repeated),
    _rows(_wide),
    _rows(_headed),
    _rows(lambda rng, rows: rows[: int(rng.integers(0, 12))]),
    _rows(lambda rng, rows: rows[:: int(rng.integers(2, 60))]),
    lambda rng, data: MAGIC[rng.integers(len(MAGIC))] + data[int(rng.integers(0, 20)) :],
    lambda rng, data: MAGIC[rng.integers(len(MAGIC))] + rng.bytes(int(rng.choice([0, 40, 5000]))),
    lambda rng, data: data.replace(b",", (b";", b"\t", b" ", b"|", b"\0", b",,")[rng.integers(6)]),
    lambda rng, data: data.replace(b"0.", (b"0,", b"-0.", b"1e300", b".")[rng.integers(4)]),
    lambda rng, data: data.replace(b"\n", (b"\r", b"\r\n\r\n", b"", b"\n#", b'\n"')[rng.integers(5)]),
    lambda rng, data: (gzip.compress, bz2.compress, lzma.compress)[rng.integers(3)](data),
    lambda rng, data: gzip.compress(bytes(200 << 20)) if rng.random() < 0.2 else gzip.compress(data)[:-7],
    _zipped,
    _encoded,
)


def damaged_record(rng: Random, board: Board) -> bytes:
    """Return a board's record with absurd numbers, effects and fields, or with bytes of it gone."""
    text = board_to_toml(board)
    for _ in range(int(rng.integers(1, 4))):
        lines = text.splitlines()
        place = int(rng.integers(len(lines)))
        number = str(rng.choice(
            ["0", "-1", "1e300", "1e-300", "nan", "inf", "-inf", "true", "'x'", "[]", "{}", "1e8", "1e-9", "9" * 400, "3.0"]
        ))  # fmt: skip
        kind = rng.integers(8)
        if kind == 0:
            del lines[place]
        elif kind == 1:
            lines[place] = lines[place].split("=")[0] + "= " + number
        elif kind in (2, 3):
            key = str(rng.choice(["value", "std"]))
            head, found, tail = lines[place].partition(f"{key} = ")
            lines[place] = head + found + number + tail[tail.find(",") if "," in tail else tail.find("}") :]
        elif kind == 4:
            names = [*catalogue(), "magnetism", ""]
            name = str(rng.choice(names))
            own = catalogue()[name].parameters if name in catalogue() else ()
            lines += ["[[effect]]", f'name = "{name}"', "[effect.parameters]"]
            lines += [
                f"{p.name} = {{ value = {math.exp(rng.uniform(-9, 7)) if rng.random() < 0.7 else number}, std = 0.0, "
                f'unit = "{p.unit}" }}'
                for p in own
                if rng.random() < 0.95
            ]
        elif kind == 5:
            odd = ("[fit]\nlogs = 'x'", "[check]\npassed = 'yes'", "[[history]]\nrmse = 'x'", "[fit]\nlogs = [1]\ndate = 3",
                   "x = " + "[" * 4000 + "]" * 4000, "[fit]\nlogs = [{path = '../../../../etc/passwd', sha256 = 'x'}]",
                   'name = "../../evil"', "[[history]]\neffects = 3", "[fit]\nunit = 3", "schema = 2")  # fmt: skip
            lines.append(odd[rng.integers(len(odd))])
        elif kind == 6:
            return damaged(rng, text.encode())
        else:
            lines[place] = lines[place] * 2
        text = "\n".join(lines) + "\n"
    return text.encode(errors="surrogateescape")


# Policies: ONNX is protobuf, of which a few lines are enough


def _field(number: int, value: bytes | int | str) -> bytes:
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    data = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _varint(value: int) -> bytes:
    data = bytearray()
    while value > 127:
        data.append(value & 127 | 128)
        value >>= 7
    return bytes([*data, value])


def _node(kind: str, inputs: Sequence[str], outputs: Sequence[str], *attributes: bytes) -> bytes:
    named = b"".join(_field(1, i) for i in inputs) + b"".join(_field(2, o) for o in outputs)
    return named + _field(4, kind) + b"".join(_field(5, a) for a in attributes)


def _value(name: str, kind: int, shape: Sequence[int]) -> bytes:
    dims = b"".join(_field(1, _field(1, n)) for n in shape)
    return _field(1, name) + _field(2, _field(1, _field(1, kind) + _field(2, dims)))


def _tensor(name: str, kind: int, shape: Sequence[int], data: bytes) -> bytes:
    return b"".join(_field(1, n) for n in shape) + _field(2, kind) + _field(8, name) + _field(9, data)


def hostile_policy(rng: Random) -> bytes:
    """Return a policy that never answers, asks for more memory than there is, or is damaged."""
    kind = rng.integers(5)
    if kind >= 2:
        return damaged(rng, (SHIPPED / "policies/pink.onnx").read_bytes())
    floats, whole, flag = 1, 7, 9
    weights = _tensor("w", floats, (390, 23), bytes(4 * 390 * 23))
    if kind == 0:
        taken = (_value("i", whole, ()), _value("go", flag, ()), _value("a", floats, (1, 23)))
        given = (_value("on", flag, ()), _value("b", floats, (1, 23)))
        body = _field(1, _node("Identity", ["go"], ["on"])) + _field(1, _node("Sin", ["a"], ["b"]))
        body += (
            _field(2, "body")
            + b"".join(_field(11, v) for v in taken)
            + b"".join(_field(12, v) for v in given)
        )
        loop = _field(1, "body") + _field(6, body) + _field(20, 5)
        nodes = [_node("MatMul", ["obs", "w"], ["x"]), _node("Loop", ["turns", "yes", "x"], ["y"], loop)]
        turns = _tensor("turns", whole, (), struct.pack("<q", 1 << 60))
        constants = [weights, turns, _tensor("yes", flag, (), b"\1")]
    else:
        side = int(rng.choice([20_000, 40_000, 3_000_000_000]))
        nodes = [
            _node("MatMul", ["obs", "w"], ["x"]),
            _node("ConstantOfShape", ["shape"], ["huge"]),
            _node("ReduceSum", ["huge"], ["sum"], _field(1, "keepdims") + _field(3, 0) + _field(20, 2)),
            _node("Add", ["x", "sum"], ["y"]),
        ]
        constants = [weights, _tensor("shape", whole, (2,), struct.pack("<2q", side, side))]
    graph = b"".join(_field(1, node) for node in nodes) + _field(2, "g")
    graph += b"".join(_field(5, constant) for constant in constants)
    graph += _field(11, _value("obs", floats, (1, 390))) + _field(12, _value("y", floats, (1, 23)))
    return _field(1, 8) + _field(7, graph) + _field(8, _field(1, "") + _field(2, 17))


# Options

NOT_TRIED = {
    "--robot", "--interface", "--viewer", "--workers", "--help", "--version", "--workspace", "--realtime",
}  # fmt: skip
"""What would move a robot, open a window or start as many processes as it says."""
WRITTEN = {"--output", "-o", "--rerun", "--overlay", "--json", "--plot"}
NUMBERS = (
    "0", "-1", "1", "2.5", "nan", "inf", "-inf", "1e308", "1e-308", "0.005", "1e6", "x", "", "1e", "²", "0x1",
)  # fmt: skip
READ = (
    "in/log", "in/none.csv", "in", "in/fifo", "/dev/null", "/dev/zero", "in/empty", "in/link", "in/loop", "in/" + "a" * 300,
)  # fmt: skip
OUTPUTS = (
    "out/x", "out/x.csv", "out/x.png", "out/x.xml", "in/log", "in/link", "out", "/dev/full", "/dev/null", "out/a/b/c", "in/loop",
    "out/é \U0001f6f9.csv", "out/" + "a" * 300, "in/fifo_read", "ws/data/boards/mine.toml",
)  # fmt: skip
WORDS = (
    "x", "deg", "roll", "-x", "2", "", "stiffness=1", "coulomb", "coulomb=0.1", "a" * 5000, "../..", "ω", "rest=nan", "mine",
)  # fmt: skip


def odd_options(
    rng: Random, arguments: Sequence[tuple[tuple[str, ...], Any]], most: int = 3
) -> Iterator[str]:
    """Yield up to `most` options of a command with values that its author did not think of."""
    options = [(names, hint) for names, hint in arguments if names and names[0].startswith("--")]
    known = [one for one in options if not NOT_TRIED & set(one[0]) and one[0] != ("--board", "-b")]
    for place in rng.permutation(len(known))[: int(rng.integers(1, most + 1))]:
        names, hint = known[place]
        name = str(rng.choice([n for n in names if n.startswith("--")]))
        kinds = [kind for kind in (typing.get_args(hint) or (hint,)) if kind not in (NoneType, Ellipsis)]
        yield name
        if kinds == [bool]:
            continue
        for kind in kinds if typing.get_origin(hint) is tuple else kinds[:1]:
            parts = typing.get_args(kind) if typing.get_origin(kind) is tuple else (kind,)
            yield from (_odd_value(rng, name, part) for part in parts if part is not Ellipsis)


def _odd_value(rng: Random, name: str, kind: Any) -> str:
    if name in WRITTEN:
        return str(rng.choice(OUTPUTS))
    if kind is Path:
        return str(rng.choice(READ))
    if kind in (int, float):
        return str(rng.choice(NUMBERS))
    literal = typing.get_args(kind)
    return str(rng.choice([*map(str, literal), *WORDS] if literal else [*WORDS, *NUMBERS]))
