"""Whole runs of the command line on known logs, and what is kept of them.

A case is a few command lines in a workspace of its own. What it prints, what it writes and its exit codes are
kept in `store/CASE.json`. Only `sysid.cli.main` is called, so that everything behind it may move.
"""

import contextlib
import datetime
import hashlib
import json
import math
import os
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from command_line import husky
from matplotlib.figure import Figure

STORE = Path(__file__).parent / "store"
REPOSITORY = Path(__file__).parents[2]
SHIPPED = REPOSITORY / "data" / "decays"
LONGEST = 12
"""Longer lists of numbers are kept as first, last, mean and RMS, other lists cut."""
DIGITS = 12
"""Significant digits that are kept of a number."""
WIDTH = 160
"""What fits into a line of so many characters is stored in one."""
_savefig = Figure.savefig
_BORDER = re.compile("[┏━┳┓┡╇┩└─┴┘ ]+")

SYNTHETIC = {
    # Angle sensors: good, coarse, jittering, slow, without a hand in the log.
    "angle.csv": "--seed 11 --releases 3",
    "angle_black.csv": "--board black --seed 12 --releases 3 --rate 500",
    "angle_quantised.csv": "--seed 13 --releases 3 --rate 500 --noise-deg 0 --quantisation-deg 0.1",
    "angle_gaps.csv": "--seed 14 --releases 3 --rate 300 --jitter 0.2 --dropout 0.05",
    "angle_slow.csv": "--seed 15 --releases 3 --rate 60 --noise-deg 0.02",
    "angle_no_hand.csv": "--seed 16 --no-hand --release-angle -8",
    "degrees.csv": "--seed 17 --releases 2 --rate 400 --dialect angle-deg",
    # Rates and inertial units.
    "gyro.csv": "--seed 21 --releases 3 --rate 400 --dialect gyro",
    "gyro_black.csv": "--board black --seed 22 --releases 2 --rate 500 --dialect gyro --gyro-bias -0.03",
    "imu.csv": "--seed 23 --releases 3 --rate 400 --dialect imu",
    "imu_black.csv": "--board black --seed 24 --releases 2 --rate 200 --dialect imu --lever-arm 0 0 0.04",
    "phyphox.csv": "--seed 25 --releases 3 --rate 200 --jitter 0.1 --dialect phyphox",
    "phyphox.zip": "--seed 26 --releases 2 --rate 200 --dialect phyphox",
    "sensor_logger.zip": "--seed 27 --releases 2 --rate 100 --dialect sensor-logger",
    # Effects that the record does not know.
    "coulomb.csv": "--seed 31 --releases 3 --rate 500 --effect coulomb=0.15",
    "stribeck.csv": "--seed 32 --releases 3 --rate 500 --effect stribeck=0.1,0.2,0.5",
    "cubic_stiffness.csv": "--seed 33 --releases 3 --rate 500 --noise-deg 0.02 --effect cubic-stiffness=150",
    "cubic_damping.csv": "--seed 34 --releases 3 --rate 500 --noise-deg 0.02 --effect cubic-damping=0.02",
    "viscoelastic.csv": "--seed 35 --releases 3 --rate 500 --noise-deg 0.02 --effect viscoelastic=8,0.02",
    "freeplay.csv": "--seed 36 --releases 3 --rate 500 --noise-deg 0.02 --effect freeplay=0.01",
    "offset_drift.csv": "--seed 37 --releases 3 --rate 500 --effect offset=0.02 --effect sensor-drift=0.001",
    "asymmetric.csv": "--seed 38 --releases 4 --rate 500 --noise-deg 0.02 --effect asymmetric-stiffness=20",
}
"""Logs made by `husky-sysid synth` at test time, and how."""
RECORDED = {"joint.mcap": "angle_gaps.csv", "imu.mcap": "imu.csv"}
"""MCAP recordings, and the synthetic log whose numbers they hold."""
FILMED = ("marker.mp4", "dots.mp4", "edge.mp4")
"""Films, rendered by `films.py` and named as there."""
FITTED = {
    "coulomb.csv": "coulomb", "stribeck.csv": "stribeck", "cubic_stiffness.csv": "cubic-stiffness",
    "cubic_damping.csv": "cubic-damping", "viscoelastic.csv": "viscoelastic", "freeplay.csv": "freeplay",
    "asymmetric.csv": "asymmetric-stiffness",
}  # fmt: skip
"""Effects that `fit` is given with a synthetic log."""

COMPARED = (
    "pink.csv", "black.csv", "pink_imu.csv", "pink_hidden.csv", "angle.csv", "angle_quantised.csv", "gyro.csv",
    "phyphox.zip", "joint.mcap", "offset_drift.csv", "freeplay.csv",
)  # fmt: skip
"""Logs that `compare` is given."""


@dataclass(frozen=True)
class Case:
    """Command lines that are run one after the other; W is their workspace, J the file for their JSON."""

    name: str
    lines: tuple[str, ...]
    needs: str = ""
    """What the stored digits depend on beside this project: 'mujoco', 'film' or nothing."""
    slow: bool = False


def cases() -> list[Case]:
    """Return every case."""
    shipped = sorted(path.name for path in SHIPPED.glob("*.csv"))
    return [
        *(case for name in (*shipped, *SYNTHETIC, *RECORDED) for case in _of_log(name)),
        *(case for name in FILMED for case in _of_film(name)),
        *_FITS, *_WHOLE, *_SCENES, *_INERTIA, *_ODD, *_DIAGNOSES,
    ]  # fmt: skip


def _of_log(name: str) -> Iterator[Case]:
    log, label = f"logs/{name}", name.replace(".", "-")
    board = f"--board {'black' if 'black' in name else 'pink'}"
    yield Case(f"roll-{label}", (f"roll {log} -o W/roll.csv --json J",))
    yield Case(f"decay-{label}", (f"decay {log} {board} --no-picture --json J",))
    if name in COMPARED:
        yield Case(f"compare-{label}", (f"compare {log} {board} --no-picture --json J",))
    effect = f" --effect {FITTED[name]}" if name in FITTED else ""
    yield Case(f"fit-{label}", (f"fit {log} {board}{effect} --json J",))


def _of_film(name: str) -> Iterator[Case]:
    log, label = f"logs/{name}", name.replace(".", "-")
    yield Case(f"roll-{label}", (f"roll {log} -o W/roll.csv --json J",), needs="film", slow=True)
    yield Case(
        f"decay-{label}", (f"decay {log} --board pink --no-picture --json J",), needs="film", slow=True
    )


_FITS = [
    *(
        Case(f"fit-{log}-with-{effect}", (f"fit logs/{log}.csv --board pink --effect {effect} --json J",))
        for log in ("pink", "pink_hidden")
        for effect in ("coulomb", "cubic-stiffness", "viscoelastic")
    ),
    Case("fit-two-logs", ("fit logs/pink.csv logs/angle.csv --board pink --json J",)),
    Case("fit-robust", ("fit logs/pink.csv --board pink --robust --json J",)),
    Case("fit-profile", ("fit logs/pink.csv --board pink --profile --json J",)),
    Case("fit-bootstrap", ("fit logs/pink.csv --board pink --bootstrap 20 --json J",)),
    Case("fit-refined", (
        "fit logs/pink_hidden.csv --board pink --effect coulomb",
        "fit logs/pink.csv --board pink --plain --json J",
    )),
    Case("fit-part-of-a-log", ("fit logs/pink.csv --board pink --from 4 --to 10 --json J",)),
]  # fmt: skip
_WHOLE = [
    Case(f"whole-way-{board}", (
        f"fit logs/{board}.csv --board {board} --in-scene --json J",
        f"compare logs/{board}.csv --board {board} --json J",
        f"check logs/{board}.csv --board {board} --json J",
        f"mjcf --board {board} -o W/scene.xml --json J",
        f"boards {board} --json J",
        "boards --json J",
    ), needs="mujoco")
    for board in ("pink", "black")
]  # fmt: skip
_SCENES = [
    Case("check-fails", ("check logs/pink_hidden.csv --board pink --json J",), needs="mujoco"),
    Case("check-an-imu", ("check logs/pink_imu.csv --board pink --tolerance 0.2 --json J",), needs="mujoco"),
    Case("check-step-compensated", (
        "fit logs/pink.csv --board pink",
        "check logs/pink.csv --board pink --export step-compensated --timestep 0.002 --json J",
    ), needs="mujoco"),
    Case("check-a-scene-file", (
        "mjcf --board black -o W/scene.xml",
        "check logs/black.csv --board black --scene-file W/scene.xml --json J",
    ), needs="mujoco"),
    *(
        Case(f"mjcf-{board}-{kind}", (f"mjcf --board {board} --{kind} -o W/{kind}.xml --json J",), needs="mujoco")
        for board in ("pink", "black")
        for kind in ("bench", "scene")
    ),
    Case("mjcf-physical", ("mjcf --board pink --export physical -o W/scene.xml --json J",), needs="mujoco"),
    Case("mjcf-direct-euler", (
        "mjcf --board pink --coupling direct --integrator Euler --timestep 0.002 -o W/scene.xml --json J",
    ), needs="mujoco"),
    Case("mjcf-with-effects", (
        "fit logs/cubic_stiffness.csv --board pink --effect cubic-stiffness",
        "mjcf --board pink --bench -o W/bench.xml --json J",
    ), needs="mujoco"),
]  # fmt: skip
_INERTIA = [
    Case("inertia", (
        "inertia cuboid --mass 2.58±0.05 --width 20±0.2cm --height 2±0.1cm --json W/cuboid.json",
        "inertia parts --cuboid 2.58±0.05,0.2,0.02,1±0.1cm --cylinder 0.2,0.005,6cm,2cm --point 0.19,6±0.2cm --json J",
        "inertia bifilar --mass 2.58±0.02 --separation 150±1mm --length 1.2±0.005 --period 1.692±0.005 --json W/b.json",
        "inertia torsional --stiffness 0.2±0.001 --period 1.31±0.002 --json J",
        "inertia compound --mass 2.58±0.02 --pivot 60±1mm --period 0.685±0.001 --amplitude 10deg --json J",
        "inertia added-mass --bare 41.1±0.2 --loaded 32.6±0.2 --mass 0.8±0.001 --offset 80±1mm --json W/added.json",
        "inertia static-tilt --reading 0.5,80±1mm,1.55±0.1deg --reading 1,80±1mm,3.05±0.1deg "
        "--reading 0.5,-80±1mm,-1.50±0.1deg --reading 1,-80±1mm,-3.10±0.1deg --frequency 41.1±0.2 --json W/tilt.json",
        "inertia combine cuboid=W/cuboid.json bifilar=W/b.json added=W/added.json tilt=W/tilt.json --json J --save pink",
        "boards pink --json J",
    )),
]  # fmt: skip
_ODD = [
    Case("boards", ("boards --json J",)),
    Case("boards-one", ("boards pink --json J",)),
    Case("boards-unknown", ("boards pnk",)),
    Case("synth", ("synth --board pink --releases 2 --rate 100 --seed 5 --effect coulomb=0.1 -o W/log.csv --json J",)),
    Case("decay-no-log", ("decay logs/README.md --board pink",)),
    Case("decay-json-on-stdout", ("decay logs/pink.csv --board pink --no-picture --json -",)),
    Case("decay-given-releases", ("decay logs/pink.csv --board pink --no-picture --release 1.71 --release 4.81 --json J",)),
    Case("decay-given-unit", ("decay logs/pink.csv --board pink --no-picture --column 2 --unit rad --rate 500 --json J",)),
    Case("decay-imu-as-gyro", ("decay logs/pink_imu.csv --board pink --no-picture --source gyro --json J",)),
    Case("roll-aligned", (
        "roll logs/phyphox.csv -o W/same.csv",
        "roll W/same.csv --align logs/phyphox.csv -o W/aligned.csv --json J",
    )),
]  # fmt: skip
_DIAGNOSES = [
    Case(f"diagnose-{log}", (f"diagnose logs/{log}.csv --board pink --workers 1 --json J",), slow=True)
    for log in ("pink", "pink_hidden")
]


def make_logs(folder: Path) -> None:
    """Make every log but the films in `folder`/logs."""
    logs = folder / "logs"
    shutil.copytree(SHIPPED, logs)
    for name, recipe in SYNTHETIC.items():
        board = "" if "--board" in recipe else "--board pink"
        done = husky("synth", *shlex.split(f"{recipe} {board} -o {logs / name}"))
        assert done.returncode == 0, done.stderr
    for name, source in RECORDED.items():
        _write_mcap(logs / name, logs / source)


def _write_mcap(path: Path, log: Path) -> None:
    from mcap.writer import Writer

    table = np.genfromtxt(log, delimiter=",", skip_header=1)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        joint = table.shape[1] == 2
        topic, kind = ("/joint_states", "JointState") if joint else ("/imu/data", "Imu")
        schema = writer.register_schema(kind, "jsonschema", b"{}")
        channel = writer.register_channel(topic, "json", schema)
        for time, *values in table.tolist():
            stamp = round((1.7e9 + time) * 1e9)
            message: dict[str, Any] = {"header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}}
            if joint:
                message |= {"name": ["board_tilt"], "position": values}
            else:
                message["linear_acceleration"] = dict(zip("xyz", values[:3], strict=True))
                message["angular_velocity"] = dict(zip("xyz", values[3:], strict=True))
            writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
        writer.finish()


def make_films(folder: Path) -> None:
    """Render every film in `folder`/logs."""
    from films import FILMS, make_film

    (folder / "logs").mkdir(exist_ok=True)
    for name in FILMED:
        make_film(folder / "logs", Path(name).stem, *FILMS[Path(name).stem])


def run(case: Case, folder: Path) -> dict[str, Any]:
    """Run a case in a folder that holds the logs, and return what is kept of it."""
    steps = []
    with contextlib.chdir(folder):
        workspace = Path(case.name)
        workspace.mkdir()
        result = workspace / "result.json"
        for line in case.lines:
            result.unlink(missing_ok=True)
            tokens = [re.sub(r"\bW/", f"{workspace}/", token) for token in shlex.split(line)]
            tokens = [str(result) if token == "J" else token for token in tokens]
            with mock.patch("matplotlib.figure.Figure.savefig", _leave_blank):
                done = husky(*tokens, "--workspace", str(workspace))
            step: dict[str, Any] = {"command": line, "exit": done.returncode}
            step |= {"stdout": _lines(done.stdout), "stderr": _lines(done.stderr)}
            if line.endswith("--json -"):
                step |= {"stdout": "only JSON", "json": summary(json.loads(done.stdout))}
            elif result.exists():
                step["json"] = summary(json.loads(result.read_text()))
            steps.append(step)
        result.unlink(missing_ok=True)
        files = {
            path.relative_to(workspace).as_posix(): _file(path)
            for path in sorted(workspace.rglob("*"))
            if path.is_file() and ".earlier" not in path.parts
        }
    return {"steps": steps, "files": files}


def _leave_blank(figure: Figure, target: Any, **options: Any) -> None:
    """Stand for `Figure.savefig`: of a picture only that it is there is kept, so it need not be painted."""
    if isinstance(target, str | Path):
        Path(target).touch()
    else:
        _savefig(figure, target, **options)


def _file(path: Path) -> Any:
    """Return what is kept of a written file: of figures and copies of the JSON only that they are there."""
    if path.suffix == ".csv":
        names = path.read_text().partition("\n")[0].split(",")
        table = np.atleast_2d(np.genfromtxt(path, delimiter=",", skip_header=1))
        return {name: summary(column.tolist()) for name, column in zip(names, table.T, strict=True)}
    if path.suffix == ".toml":
        record = tomllib.loads(path.read_text())
        shipped = tomllib.loads((REPOSITORY / "data" / "boards" / path.name).read_text())
        return {key: summary(value) for key, value in record.items() if shipped.get(key) != value}
    if path.suffix == ".xml":
        return _lines(path.read_text())
    return "written"


def _lines(text: str) -> list[str]:
    """Return the lines of a text without tables' borders and what differs between days and machines."""
    text = text.replace(str(REPOSITORY), "REPOSITORY")
    text = text.replace(os.path.relpath(REPOSITORY, Path.cwd()), "REPOSITORY")
    text = re.sub(r"\b20\d\d-\d\d-\d\d\b", _date, text)
    text = re.sub(r"\b[0-9a-f]{64}\b", "SHA256", text)
    text = re.sub(rf"(?<![\d.]){re.escape(version('husky-sysid'))}(?![\d.])", "VERSION", text)
    text = re.sub(r"\b\d+\.\d{9,}(e[+-]?\d+)?\b", lambda number: f"{float(number[0]):.7g}", text)
    text = re.sub(r"[┃│]", "|", text)
    text = re.sub(r" {2,}", "  ", text)
    return [line.rstrip() for line in text.splitlines() if not _BORDER.fullmatch(line)]


def _date(found: re.Match[str]) -> str:
    now = datetime.datetime.now().astimezone()
    recent = {str(day.date()) for day in (now, now.astimezone(datetime.UTC))}
    return "TODAY" if found[0] in recent else found[0]


def summary(value: Any) -> Any:
    """Return a JSON value shortened: numbers rounded, tables by columns, long lists of numbers told by a few."""
    match value:
        case dict():
            return {key: summary(item) for key, item in value.items()}
        case list() if len(value) > LONGEST and all(isinstance(item, int | float) for item in value):
            array = np.array(value)
            told = [array[0], array[-1], array.mean(), math.sqrt(np.mean(array**2))]
            return {
                "count": len(value),
                **dict(zip(("first", "last", "mean", "rms"), summary(told), strict=True)),
            }
        case [dict() as first, dict(), *_] if all(
            _flat(item) and list(item) == list(first) for item in value
        ):
            return {key: summary([item[key] for item in value]) for key in first}
        case list():
            rest = [f"and {len(value) - LONGEST} more"] if len(value) > LONGEST else []
            return [*map(summary, value[:LONGEST]), *rest]
        case float():
            return float(f"{value:.{DIGITS}g}")
        case str():
            return "\n".join(_lines(value))
        case _:
            return value


def _flat(row: dict[str, Any]) -> bool:
    return not any(isinstance(value, dict | list) for value in row.values())


def machine() -> dict[str, str]:
    """Return what stored digits depend on beside this project: MuJoCo's version, and how it draws here."""
    return {"mujoco": version("mujoco"), "film": _drawing()}


def _drawing() -> str:
    """Return a hash of a picture that MuJoCo draws here, with what writes and reads films; '' if it draws none."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><light pos='0 -1 2' dir='0 0.4 -0.9'/><geom type='box' size='.1 .05 .02' "
        "euler='10 20 30'/><camera name='c' pos='0 -0.5 0.1' xyaxes='1 0 0 0 0.2 1'/></worldbody></mujoco>"
    )
    try:
        with mujoco.Renderer(model, 64, 64) as renderer:
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "c")
            picture = renderer.render().tobytes()
        tools = "".join(version(name) for name in ("mujoco", "opencv-python-headless", "av"))
    except Exception:  # noqa: BLE001  whatever a machine without OpenGL raises
        return ""
    return hashlib.sha256(picture + tools.encode()).hexdigest()[:16]


def write(name: str, content: Any) -> None:
    """Put a result into the store."""
    STORE.mkdir(exist_ok=True)
    (STORE / f"{name}.json").write_text(_dumps(content) + "\n")


def _dumps(value: Any, indent: str = "") -> str:
    """Return JSON of which every object that fits into a line stands in one."""
    flat = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if len(indent + flat) <= WIDTH or not isinstance(value, dict | list):
        return flat
    inner = indent + " "
    if isinstance(value, dict):
        items = [
            f"{json.dumps(key, ensure_ascii=False)}: {_dumps(item, inner)}" for key, item in value.items()
        ]
    else:
        items = [_dumps(item, inner) for item in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{inner}" + f",\n{inner}".join(items) + f"\n{indent}{closing}"


def read(name: str) -> Any:
    """Return a result from the store."""
    return json.loads((STORE / f"{name}.json").read_text())


def differences(stored: Any, found: Any, *, rtol: float, atol: float, where: str = "") -> Iterator[str]:
    """Yield what differs: numbers beyond the tolerance, everything else exactly."""
    if isinstance(stored, dict) and isinstance(found, dict) and list(stored) == list(found):
        for key in stored:
            yield from differences(stored[key], found[key], rtol=rtol, atol=atol, where=f"{where}.{key}")
    elif isinstance(stored, list) and isinstance(found, list) and len(stored) == len(found):
        for number, pair in enumerate(zip(stored, found, strict=True)):
            yield from differences(*pair, rtol=rtol, atol=atol, where=f"{where}[{number}]")
    elif isinstance(stored, float) and isinstance(found, int | float):
        if not math.isclose(stored, found, rel_tol=rtol, abs_tol=atol):
            yield f"{where}: stored {stored!r}, now {found!r}"
    elif stored != found:
        yield f"{where}:\n  stored {_shown(stored)}\n  now    {_shown(found)}"


def _shown(value: Any) -> str:
    return (
        "\n         ".join(value)
        if isinstance(value, list) and all(isinstance(v, str) for v in value)
        else repr(value)
    )


def selected(names: Sequence[str]) -> list[Case]:
    """Return the cases whose names contain one of `names`; all without."""
    return [case for case in cases() if not names or any(name in case.name for name in names)]
