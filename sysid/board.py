"""The board record: measurements in, MJCF numbers derived; one TOML file a board.

The record holds measurements with uncertainties, fitted numbers and their logs, the verdict of `check`, and one history line per
refit.
"""

import hashlib
import math
import sys
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import tomlkit

from sysid.errors import SysidError, did_you_mean
from sysid.files import read_small, shipped_data, write_atomically
from sysid.quantity import Quantity, slide_unit
from sysid.shown import MOST_SHOWN, Shown

SCHEMA = 1
"""Version of the record's format; another one is refused."""

GEOMETRY_UNITS = {
    "length": "m",
    "width": "m",
    "thickness": "m",
    "wheelbase": "m",
    "track": "m",
    "wheel_radius": "m",
    "truck_height": "m",
    "rake": "rad",
}
"""`truck_height` is the distance from the tilt axis down to the axles; `rake` is λ of tan σ = tan λ sin γ."""
MASS_UNITS = {"deck": "kg", "truck": "kg", "wheel": "kg"}
"""One deck, each of two trucks, each of four wheels."""
TILT_UNITS = {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest_angle": "rad", "range": "rad"}
"""`range` is the largest tilt to either side; `rest_angle` is a roll (right edge down is positive)."""
DECAY_UNITS = {"period": "s", "first_peak": "rad", "second_peak": "rad"}
MAY_LACK = ("stiffness", "damping")
"""Quantities that may be 0: gravity alone pulls a pendulum back, and dry friction alone stops a servo."""
ROLLING_UNITS = {"deceleration": "m/s^2"}
"""Loss of speed at 1 m/s on level ground."""
PUBLISHED_UNITS = {"stiffness": "N*m/rad", "damping": "N*m*s/rad"}

OPTIONAL = {
    "geometry": GEOMETRY_UNITS, "mass": MASS_UNITS, "decay": DECAY_UNITS, "rolling": ROLLING_UNITS,
    "published": PUBLISHED_UNITS,
}  # fmt: skip
"""Optional sections."""
TOLD = {"fit": "fit", "check": "last_check", "model": "model"}
"""Sections that commands write, and the fields that hold them."""
TOLD_NUMBERS = {"rmse_before", "rmse", "heldout_rmse", "noise_floor", "nrmse", "tolerance"}
"""Numbers that commands read from these sections and from the history."""
PHYSICAL = (1e-9, 1e6)
"""Smallest and largest size of a record's quantities [SI unit], from a watch's balance wheel to a lorry's axle. Other sizes make a
simulation endless or divide by zero."""
FINEST = 1e-4
"""Smallest length [m] and mass [kg] of a record."""


@dataclass(frozen=True, slots=True)
class BoardEffect:
    """One effect beyond spring and damper, with its fitted parameters."""

    name: str
    """A name of the effect catalogue (`sysid.effects`)."""
    parameters: Mapping[str, Quantity]
    file: str = ""
    """File of the user's own effect, else ''."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Board(Shown):
    """The record of one board or joint."""

    name: str
    description: str
    source: str
    geometry: Mapping[str, Quantity] = field(default_factory=dict[str, Quantity])
    mass: Mapping[str, Quantity] = field(default_factory=dict[str, Quantity])
    inertia: Quantity
    """Inertia of the moved bodies about the axis [kg*m^2]."""
    tilt: Mapping[str, Quantity]
    decay: Mapping[str, Quantity] = field(default_factory=dict[str, Quantity])
    """The free decay that gave stiffness and damping before a fit."""
    rolling: Mapping[str, Quantity] = field(default_factory=dict[str, Quantity])
    """Measured rolling resistance."""
    published: Mapping[str, Quantity] = field(default_factory=dict[str, Quantity])
    """Stiffness and damping as printed by the source, for comparison only."""
    effects: tuple[BoardEffect, ...] = ()
    fit: Mapping[str, Any] = field(default_factory=dict[str, Any])
    last_check: Mapping[str, Any] = field(default_factory=dict[str, Any])
    model: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """The MuJoCo model of the joint, and its pose: file, joint, keyframe, pose, free, payload."""
    history: tuple[Mapping[str, Any], ...] = ()

    @classmethod
    def load(cls, name: str | Path, workspace: str | Path = ".") -> "Board":
        """Read the record of a board.

        Args:
            name: A board of the workspace, or one that ships with the tool; or a file, NAME.toml.
            workspace: Folder with the user's boards, in data/boards.

        Raises:
            SysidError: There is no such board, or its record is not valid.
        """
        path = Path(name)
        return load_board(path) if path.suffix == ".toml" else load_named(str(name), Path(workspace))

    def save(self, path: str | Path) -> None:
        """Write the record into a TOML file, in one step: a crash at any moment leaves an old one whole."""
        save_board(self, Path(path))

    def brief(self) -> str:
        """Return name, inertia, stiffness, damping, effects, and whether it passed the check."""
        k, d = self.tilt["stiffness"], self.tilt["damping"]
        numbers = [f"I = {self.inertia}", *([] if self.is_unmeasured else [f"k = {k}", f"d = {d}"])]
        parts = [
            f"{part.name} ({', '.join(f'{name} {q}' for name, q in fitted[:MOST_SHOWN])})"
            if fitted
            else part.name
            for part in self.effects
            for fitted in [[(name, q) for name, q in part.parameters.items() if q.value]]
        ]
        lines = [
            f"{type(self).__name__} {self.name}: {self.description}",
            f"  {', '.join(numbers)}",
            *(f"  + {part}" for part in parts[:MOST_SHOWN]),
            f"  check: {self.check_state}",
        ]
        return "\n".join(lines)

    @property
    def stiffness(self) -> float:
        """Linear tilt stiffness k [N*m/rad]."""
        return self.tilt["stiffness"].value

    @property
    def damping(self) -> float:
        """Linear tilt damping d [N*m*s/rad]."""
        return self.tilt["damping"].value

    @property
    def rest_angle(self) -> float:
        """Roll at rest [rad]."""
        return self.tilt["rest_angle"].value

    @property
    def quantities(self) -> dict[str, Quantity]:
        """Quantities of the joint by name: those of the tilt joint, and 'effect.parameter'."""
        of_effects = {f"{part.name}.{n}": q for part in self.effects for n, q in part.parameters.items()}
        return {**self.tilt, **of_effects}

    @property
    def is_unmeasured(self) -> bool:
        """Whether no parameter of the joint has been measured."""
        return self.stiffness == 0 == self.damping and not self.fit

    @property
    def passed(self) -> bool:
        """Whether `check` accepted the current record."""
        return bool(self.last_check.get("passed", False)) and not self.check_is_stale

    @property
    def check_state(self) -> str:
        """The last check in words."""
        if not self.last_check:
            return "not run"
        return "out of date" if self.check_is_stale else "passed" if self.passed else "failed"

    @property
    def check_is_stale(self) -> bool:
        """Whether the record has changed since it was checked: another fit, or an edit by hand."""
        return bool(self.last_check) and self.last_check.get("digest") != self.digest

    @property
    def digest(self) -> str:
        """SHA-256 of the numbers that a check judges: geometry, masses, inertia, tilt joint and effects."""
        judged = replace(
            self, description="", source="", decay={}, published={}, fit={}, last_check={}, history=()
        )
        return hashlib.sha256(board_to_toml(judged).encode()).hexdigest()

    def need(self, purpose: str) -> None:
        """Check that the record describes the whole board, geometry and masses included.

        Raises:
            SysidError: Geometry or masses are missing; the message names the purpose.
        """
        if self.model:
            raise SysidError(
                f"'{self.name}' is the {self.description}, and {purpose} is of a skateboard. `husky-sysid fit` writes the joint "
                "into a copy of its model (-o FILE)."
            )
        if missing := [f"[{name}]" for name in ("geometry", "mass") if not getattr(self, name)]:
            raise SysidError(
                f"the record of '{self.name}' has no {' and no '.join(missing)}: {purpose} needs them. Measure them with a tape "
                f"and a scale and add them to the record (docs/boards.md names the fields)."
            )

    @property
    def options(self) -> tuple[str, ...]:
        """Options of the command line that name the joint and the files of its own effects."""
        needed = [
            word
            for part in self.effects
            if part.file.endswith(".py")
            for word in ("--effect-file", part.file)
        ]
        if not self.model:
            return "--board", self.name, *needed
        words = [word for name in ("file", "joint", "keyframe") if name in self.model
                 for word in ("--model" if name == "file" else f"--{name}", str(self.model[name]))]  # fmt: skip
        words += [
            word for name, at in self.model.get("pose", {}).items() for word in ("--pose", f"{name}={at:g}")
        ]
        words += [
            word
            for name in ("free", "payload")
            for one in self.model.get(name, ())
            for word in (f"--{name}", one)
        ]
        return *words, *needed

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic: its units are then m, N/m and kg."""
        return self.inertia.unit == "kg"

    def experiment(self, name: str) -> str:
        """Return the experiment that distinguishes an effect, with releases in the joint's unit and range."""
        from sysid.effects import effect

        return effect(name).experiment_on(slides=self.slides, widest=self.tilt["range"].value)

    @property
    def error_unit(self) -> str:
        """Unit of the errors of its fits: the unit of the fitted signal."""
        unit = str(self.fit.get("unit", "rad"))
        return slide_unit(unit) if self.slides else unit

    def of_slide(self) -> Self:
        """Return the record with the units of a slide."""

        def turned(quantities: Mapping[str, Quantity]) -> dict[str, Quantity]:
            return {name: replace(q, unit=slide_unit(q.unit)) for name, q in quantities.items()}

        return replace(
            self, inertia=replace(self.inertia, unit="kg"), tilt=turned(self.tilt),
            effects=tuple(replace(part, parameters=turned(part.parameters)) for part in self.effects),
        )  # fmt: skip

    def checked(self, entry: Mapping[str, Any]) -> Self:
        """Return a copy with the verdict of a check, valid until the judged numbers change."""
        return replace(self, last_check={**entry, "digest": self.digest})

    def with_tilt(self, **quantities: Quantity) -> Self:
        """Return a copy with some quantities of the tilt joint replaced."""
        return replace(self, tilt={**self.tilt, **quantities})


def require_record(board: object) -> None:
    """Accept the record of a joint.

    Raises:
        SysidError: It is something else.
    """
    if not isinstance(board, Board):
        raise SysidError(
            f"a {type(board).__name__} is no joint. A joint is sysid.Joint.load('pink'), "
            "sysid.Joint.from_mjcf('robot.xml', 'knee') or sysid.Joint.new('rig', '0.0087±0.0001')."
        )


def boards_folder(workspace: Path) -> Path:
    """Return the folder of a workspace's records."""
    return workspace / "data" / "boards"


def record_names(workspace: Path) -> list[str]:
    """Return the names of all boards: the workspace's and the shipped ones."""
    folders = (boards_folder(workspace), shipped_data() / "boards")
    return sorted({path.stem for folder in folders for path in folder.glob("*.toml")})


def find_record(name: str, workspace: Path) -> Path:
    """Return the file of a record: the workspace's, else the shipped one.

    Raises:
        SysidError: There is no board of that name.
    """
    own = boards_folder(workspace)
    for folder in (own, shipped_data() / "boards"):
        path = folder / f"{name}.toml"
        if name and Path(name).name == name and path.is_file():
            return path
    names = record_names(workspace)
    raise SysidError(
        f"unknown board '{name}'.{did_you_mean(name, names)} Known boards: {', '.join(names)}. "
        f"A new one is a file {own / f'{name}.toml'}; `husky-sysid new` writes it."
    )


def load_named(name: str, workspace: Path) -> Board:
    """Read a record by its name.

    Raises:
        SysidError: There is no such board, or its record is not valid.
    """
    path = find_record(name, workspace)
    board = load_board(path)
    if board.name != path.stem:
        raise SysidError(f"{path}: field 'name' is '{board.name}'; expected '{path.stem}', as the file.")
    return board


def load_board(path: Path) -> Board:
    """Read and validate one board record.

    Raises:
        SysidError: The file is missing or not TOML, or a field is missing, unknown, of the wrong kind or in the wrong unit. The
            message names file, field and the expected value.
    """
    try:
        raw = tomllib.loads(read_small(path))
    except (OSError, UnicodeDecodeError) as error:
        raise SysidError(f"{path}: cannot read the board record ({error}).") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SysidError(f"{path}: not a TOML file ({error}).") from error
    return _Reader(path).board(raw)


def save_board(board: Board, path: Path) -> None:
    """Write the record in one step: a crash at any moment leaves the old file whole."""
    text = board_to_toml(board)
    _Reader(path).board(tomllib.loads(text))  # a written record can be read back
    write_atomically(path, text, is_record=True)


def board_to_toml(board: Board) -> str:
    """Return the record as TOML text."""
    document = tomlkit.document()
    document["schema"] = SCHEMA
    document["name"] = board.name
    document["description"] = board.description
    document["source"] = board.source
    for section in ("geometry", "mass", "inertia", "decay", "published", "tilt", "rolling"):
        content = getattr(board, section)
        if section == "inertia":
            document[section] = {**_fields(board.inertia), "method": board.inertia.method}
        elif content:
            document[section] = _quantities(content)
    if board.effects:
        effects = tomlkit.aot()
        for effect in board.effects:
            table = tomlkit.table()
            table["name"] = effect.name
            if effect.file:
                table["file"] = effect.file
            table["parameters"] = _quantities(effect.parameters)
            effects.append(table)
        document["effect"] = effects
    for name, content in (("model", board.model), ("fit", board.fit), ("check", board.last_check)):
        if content:
            document[name] = dict(content)
    if board.history:
        lines = tomlkit.aot()
        for line in board.history:
            table = tomlkit.table()
            table.update(line)
            lines.append(table)
        document["history"] = lines
    return tomlkit.dumps(document)


def _quantities(quantities: Mapping[str, Quantity]) -> Any:
    table = tomlkit.table()
    for name, quantity in quantities.items():
        inline = tomlkit.inline_table()
        inline.update(_fields(quantity))
        table[name] = inline
    return table


def _fields(quantity: Quantity) -> dict[str, float | str]:
    return {"value": float(quantity.value), "std": float(quantity.std), "unit": quantity.unit}


@dataclass(frozen=True, slots=True)
class _Reader:
    """Turns raw TOML into a Board; the path is for messages."""

    path: Path

    def board(self, raw: Mapping[str, Any]) -> Board:
        known = {
            "schema", "name", "description", "source", "geometry", "mass", "inertia", "decay", "published",
            "tilt", "rolling", "effect", "model", "fit", "check", "history",
        }  # fmt: skip
        self._refuse_unknown(raw, known, "")
        if raw.get("schema") != SCHEMA:
            raise SysidError(f"{self.path}: schema is {raw.get('schema')!r}, expected {SCHEMA}.")
        inertia = self._table(raw, "inertia")
        kind = slide_unit if inertia.get("unit") == "kg" else str
        return Board(
            name=self._text(raw, "name"),
            description=self._text(raw, "description"),
            source=self._text(raw, "source"),
            inertia=self._quantity(inertia, "inertia", kind("kg*m^2"), positive=True).with_method(
                self._text(inertia, "method", "inertia.method")
            ),
            tilt=self._quantities(raw, "tilt", {n: kind(u) for n, u in TILT_UNITS.items()}),
            effects=tuple(
                self._effect(f"effect[{i}]", own, kind) for i, own in enumerate(self._tables(raw, "effect"))
            ),
            history=tuple(
                self._told(f"history[{i}]", line) for i, line in enumerate(self._tables(raw, "history"))
            ),
            **{name: self._quantities(raw, name, units) for name, units in OPTIONAL.items() if name in raw},
            **{
                field: self._told(name, self._table(raw, name)) for name, field in TOLD.items() if name in raw
            },
        )

    def _told(self, where: str, raw: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a table that commands wrote; the fields that they read have the right kind."""
        for key in TOLD_NUMBERS & raw.keys():
            self._number(raw, key, f"{where}.{key}")
        arrays: dict[str, tuple[type, str]] = {"effects": (str, "names of effects")}
        if where == "fit":  # a check's logs are names
            arrays["logs"] = Mapping, "tables with path and sha256"
        for key, (of, kind) in arrays.items():
            items: Any = raw.get(key, [])
            if not isinstance(items, list) or not all(isinstance(item, of) for item in items):
                raise self._wrong(f"field '{where}.{key}'", items, f"an array of {kind}")
        texts = {"fit": [key for key in ("reading",) if key in raw], "model": ["file", "joint"]}
        for key in texts.get(where, ()):
            self._text(raw, key, f"{where}.{key}")
        for i, log in enumerate(raw.get("logs", ()) if where == "fit" else ()):
            self._text(log, "path", f"fit.logs[{i}].path")
        return raw

    def _effect(self, where: str, raw: Mapping[str, Any], unit_of: Callable[[str], str]) -> BoardEffect:
        """Read one effect, its parameters in the catalogue's order and in the units of the record's kind of joint.

        An effect that is not in the catalogue is kept unchanged.
        """
        from sysid.effects import catalogue

        name = self._text(raw, "name", f"{where}.name")
        table = self._table(raw, "parameters", f"{where}.parameters")
        known = catalogue().get(name)
        units = dict.fromkeys(table) if known is None else {p.name: unit_of(p.unit) for p in known.parameters}
        self._refuse_unknown(table, units, place := f"{where} ({name}).parameters.")
        values = {key: self._quantity(table.get(key), place + key, unit) for key, unit in units.items()}
        return BoardEffect(name, values, self._text(raw, "file", f"{where}.file") if "file" in raw else "")

    def _refuse_unknown(self, table: Mapping[str, Any], known: Collection[str], where: str) -> None:
        if unknown := [key for key in table if key not in known]:
            told = f" Known: {', '.join(known)}." if where else ""
            hint = did_you_mean(unknown[0], known)
            raise SysidError(f"{self.path}: unknown field '{where}{unknown[0]}'.{hint}{told}")

    def _quantities(
        self, raw: Mapping[str, Any], section: str, units: Mapping[str, str]
    ) -> dict[str, Quantity]:
        table = self._table(raw, section)
        self._refuse_unknown(table, units, f"{section}.")
        found: dict[str, Quantity] = {}
        for key, unit in units.items():
            own: Any = table.get(key)
            is_zero = isinstance(own, Mapping) and own.get("value") == 0
            positive = key != "rest_angle" and not (key in MAY_LACK and is_zero)
            found[key] = self._quantity(own, f"{section}.{key}", unit, positive=positive)
        return found

    def _quantity(self, raw: Any, where: str, unit: str | None, *, positive: bool = False) -> Quantity:
        if not isinstance(raw, Mapping):
            shape = f"{{ value = …, std = …, unit = '{unit or '…'}' }}"
            raise self._wrong(f"field '{where}'", raw, shape)
        value, std = (self._number(raw, key, f"{where}.{key}") for key in ("value", "std"))
        if raw.get("unit") != unit and not (unit is None and isinstance(raw.get("unit"), str)):
            raise self._wrong(f"field '{where}.unit'", raw.get("unit"), repr(unit))
        if not 0 <= std < math.inf:
            raise self._wrong(f"field '{where}.std'", std, "0 or more")
        if not math.isfinite(value) or (positive and value <= 0):
            kind = "a positive number" if positive else "a finite number"
            raise self._wrong(f"field '{where}.value'", value, kind)
        least = FINEST if unit in ("m", "kg") else PHYSICAL[0]
        most = math.pi if unit == "rad" else PHYSICAL[1]
        if unit is not None and ((positive and abs(value) < least) or abs(value) > most):
            raise SysidError(
                f"{self.path}: field '{where}.value' is {value:g} {unit}; expected {least:g} to {most:.4g}. Is it in another unit?"
            )
        return Quantity(value, std, str(raw["unit"]))

    def _number(self, raw: Mapping[str, Any], key: str, where: str) -> float:
        number: Any = raw.get(key)
        # TOML's whole numbers may exceed a float.
        whole = isinstance(number, int) and not isinstance(number, bool) and abs(number) < sys.float_info.max
        if not whole and not isinstance(number, float):
            raise self._wrong(f"field '{where}'", number, "a number")
        return float(number)

    def _table(self, raw: Mapping[str, Any], key: str, where: str = "") -> Mapping[str, Any]:
        value = raw.get(key)
        if not isinstance(value, Mapping):
            raise self._wrong(f"section '[{where or key}]'", value, "a table")
        return value

    def _tables(self, raw: Mapping[str, Any], key: str) -> Sequence[Mapping[str, Any]]:
        value: Any = raw.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, Mapping) for item in value):
            raise self._wrong(f"'[[{key}]]'", value, "an array of tables")
        return value

    def _text(self, raw: Mapping[str, Any], key: str, where: str = "") -> str:
        value = raw.get(key)
        if not isinstance(value, str):
            raise self._wrong(f"field '{where or key}'", value, "a text")
        return value

    def _wrong(self, what: str, value: object, expected: str) -> SysidError:
        found = "missing" if value is None else repr(value)
        return SysidError(f"{self.path}: {what} is {found}; expected {expected}.")
