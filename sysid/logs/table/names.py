"""Quantity, axis and unit from a column's name.

Names come from phones, robots and spreadsheets: `roll_deg`, `gyroX (rad/s)`, `angular_velocity.x`,
`Gyroscope x (rad/s)`, `ax`. A name is cut into words, its unit is taken off, and the words that are
left decide. Open questions stay None, and the content decides (`sysid.logs.table.choose`).
"""

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "time", "angle", "rate", "accel", "quaternion", "length", "speed", "std", "count", "other", "unknown"
]

_SPELLINGS: dict[Kind, dict[str, str]] = {
    "angle": {
        "rad": "radian|radians|rads|радиан|рад",
        "mrad": "milliradian|milliradians",
        "deg": "degree|degrees|degs|°|grad|º|graus|gradi|grados|degré|degrés|stopnie|град|градусы|度",
        "mdeg": "millidegree|millidegrees",
        "turn": "turns|rev|revs|revolution|revolutions",
    },
    "rate": {
        "rad/s": "rad s|radps|rad/sec|rad sec|rad s-1|rad s 1|rad per s|rad·s⁻¹|rads/s|рад/с",
        "mrad/s": "mrad s|mradps",
        "deg/s": "deg s|degps|dps|°/s|º/s|deg/sec|deg sec|degrees/s|degrees s|deg s 1",
        "mdeg/s": "mdps|mdeg s",
        "turn/s": "turns/s|rev/s|rps",
        "rpm": "rev/min|rev min",
    },
    "accel": {
        "m/s^2": "m/s2|m/s²|m s2|m s 2|m s^2|mps2|ms2|ms-2|m s-2|m/s/s|m s s",
        "g": "gs|g0|gee",
        "mg": "millig",
    },
    "length": {
        "m": "meter|meters|metre|metres",
        "cm": "centimeter|centimeters|centimetre|centimetres",
        "mm": "millimeter|millimeters|millimetre|millimetres",
        "in": "inch|inches",
        "px": "pixel|pixels",
    },
    "speed": {"m/s": "m s|mps", "cm/s": "cm s", "mm/s": "mm s"},
    "time": {
        "s": "sec|secs|second|seconds|sek|sekunden|сек|с|秒|초",
        "ms": "msec|msecs|millis|millisecond|milliseconds|мс|毫秒",
        "us": "usec|usecs|micros|microsecond|microseconds|µs|μs",
        "ns": "nsec|nsecs|nanos|nanosec|nanosecond|nanoseconds",
        "cs": "centisecond|centiseconds",
        "100 us": "100us",
        "100 ns": "100ns",
        "min": "minute|minutes",
        "h": "hr|hrs|hour|hours",
    },
}
"""Units by quantity, and other spellings."""
_SIZES = {
    **dict.fromkeys(("rad", "m", "px", "s", "s^2"), 1.0),
    "deg": math.radians(1), "turn": math.tau, "in": 0.0254, "g": 9.80665, "min": 60.0, "h": 3600.0, "rpm": math.tau / 60.0,
}  # fmt: skip
"""Units without a prefix, in SI; a pixel is a length of its own."""
_PARTS = {"c": 1e2, "m": 1e3, "u": 1e6, "n": 1e9}
"""Of a unit in one, by prefix."""


def _size(unit: str) -> float:
    """Return one of a unit in SI: 'mdeg/s' is a prefix, an angle and a time."""
    top, _, below = unit.partition("/")
    number, _, top = top.rpartition(" ")
    whole, parts = (_SIZES[top], 1.0) if top in _SIZES else (_SIZES[top[1:]], _PARTS[top[0]])
    return float(number or 1) * whole / parts / _SIZES[below or "s"]


ANGLE_UNITS, RATE_UNITS, ACCEL_UNITS, LENGTH_UNITS, SPEED_UNITS, TIME_UNITS = (
    {unit: _size(unit) for unit in units} for units in _SPELLINGS.values()
)
"""rad, rad/s, m/s², m, m/s and s in one of each unit."""
MAX_RATE = 35.0
"""No common gyro measures more than 2000 °/s = 34.9 rad/s: larger numbers are degrees [rad/s]."""
_UNIT_KIND: dict[str, Kind] = {unit: kind for kind, units in _SPELLINGS.items() for unit in units}
_UNITS = {
    alias: unit
    for units in _SPELLINGS.values()
    for unit, more in units.items()
    for alias in (unit, *more.split("|"))
}


def _plain(text: str) -> str:
    """Return text without the marks above and below its letters: é is e."""
    letters = (c for c in unicodedata.normalize("NFD", text) if not unicodedata.category(c).startswith("M"))
    return unicodedata.normalize("NFC", "".join(letters))


def _vocabulary(words: str) -> set[str]:
    return set(_plain(words).split("|"))


_TIME_WORDS = _vocabulary(
    "t|time|times|timestamp|timestamps|stamp|elapsed|clock|ts|epoch|datetime|utc|millis|micros|arrival|"
    "tick|ticks|zeit|zeitpunkt|uhrzeit|tiempo|temps|tempo|czas|tid|tijd|aika|cas|ido|timp|zaman|sure|"
    "vreme|vrijeme|tempus|thoi|waktu|masa|время|час|χρονος|時間|时间|時刻|时刻|시간|समय|เวลา|الزمن|الوقت|زمن|זמן"
)
_RATE_WORDS = _vocabulary(
    "gyro|gyr|gyroscope|gyroscopes|gyroskop|giroscopio|gyroskopet|omega|rate|speed|velocity|vel|dot|qvel|"
    "angvel|thetadot|phidot|angularvelocity|angularrate|rotationrate|qd|dq|qdot|winkelgeschwindigkeit|"
    "drehrate|geschwindigkeit|velocidad|velocidade|vitesse|velocita|predkosc|rychlost|hastighet|snelheid|"
    "nopeus|sebesseg|viteza|hiz|скорость|γωνιακη|角速度|角速率|速度|각속도|속도"
)
_GYRO_WORDS = _vocabulary("gyro|gyr|gyroscope|gyroskop|giroscopio")
_COMPUTED_WORDS = _vocabulary("angle|angles|integrated|integral")
"""Words beside the name of a gyro or an accelerometer that say the angle which was made of it: 'gyro_angle_x', 'accAngleY'."""
_ACCEL_WORDS = _vocabulary(
    "acc|accel|accelerometer|acceleration|acceler|beschleunigung|aceleracion|aceleracao|accelerazione|"
    "przyspieszenie|acceleratie|ускорение|加速度|가속도"
)
_QUATERNION_WORDS = _vocabulary("q|quat|quaternion|orientation|attitude")
_ROLL_WORDS = _vocabulary(
    "roll|phi|bank|heel|tilt|lean|rollwinkel|neigung|roulis|rollio|alabeo|balanceo|inclinaison|крен|ロール|"
    "横滚|滚转|롤"
)
_ANGLE_WORDS = _ROLL_WORDS | _vocabulary(
    "angle|theta|pitch|yaw|heading|psi|pos|position|q|qpos|encoder|enc|inclination|deflection|swing|euler|"
    "rpy|ang|rotation|winkel|drehwinkel|angulo|angolo|vinkel|hoek|kat|kulma|uhel|uhol|szog|aci|unghi|kut|"
    "sudut|goc|угол|γωνια|кут|角度|角|각도|कोण|زاوية|זווית|มุม"
)
_OTHER_WORDS = _vocabulary(
    "mag|magnetometer|magnetic|magn|temp|temperature|pressure|battery|voltage|current|torque|effort|force|"
    "tau|amps|ampere|iq|pwm|duty|load|latitude|longitude|altitude|heave|surge|sway|area|frame|index|"
    "sample|count|seq|id|row|accuracy|absolute|norm|covariance|gravity|light|sound|movement|label|height|"
    "width|enable|enabled|done|reward|task|mode|status|error_code"
)
_KNOWN_WORDS = (
    _TIME_WORDS | _RATE_WORDS | _ACCEL_WORDS | _QUATERNION_WORDS | _ANGLE_WORDS | {"angular", *"wxyz"}
)
_PLACES = _vocabulary("x|y|z|pos|position|distance|displacement|travel")
"""Words before a lone 'm' that is a unit."""
_COUNT_WORDS = {"tick", "ticks", "count", "counts", "pulse", "pulses", "step", "steps"}
_STD_WORDS = {"std", "sigma", "stdev", "stddev", "sd"}
_DOUBTFUL = _vocabulary(
    "ref|reference|truth|mocap|optical|goal|target|cmd|command|commanded|setpoint|desired|des|action|raw|"
    "logged|err|error|model|sim|simulated|predicted|uncalibrated|wrapped|old|linear|user|fused|free|"
    "arrival|receive|received|gps|soll"
)
"""Words of columns that are not the plain measurement: goals, references, second-hand copies."""
_DRIVING = {"motor", "rotor"}
"""Words of a gear's other side: less doubtful than those above, more than the joint."""
_GLUED = re.compile(
    r"(gyroscope|gyro|gyr|omega|w|g|accelerometer|accel|acc|a|magnetometer|mag|m|quat|q|rot)([xyzw])"
)
_GLUED_WORD = {"w": "omega", "g": "gyro", "a": "acc", "m": "mag", "q": "quat", "rot": "gyro"}
_CLOCKS = {"sample time fine": "100 us", "x value": "s"}
"""Clocks of Xsens and LabVIEW."""
_VECTORS = _QUATERNION_WORDS | _GYRO_WORDS | _vocabulary("acc|accel|accelerometer|angular|rpy|euler|xyz")
"""Words of vectors: an index behind them is an axis. The index of `position[0]` is a joint."""
_GREEK = {"φ": "phi", "ϕ": "phi", "θ": "theta", "ω": "omega", "γ": "tilt", "ψ": "psi"}
_SYMBOL = re.compile(rf"(?<![α-ω])[{''.join(_GREEK)}](?![α-ω])")
"""Greek letters that stand alone, and so are symbols."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column, as far as its name tells."""

    name: str
    kind: Kind
    axis: str
    """'x', 'y', 'z' or 'w'; an angle's 'x' is roll, 'y' pitch, 'z' yaw; '' where the name is silent."""
    unit: str | None
    """A key of the tables above, or None where the name is silent."""
    doubt: int
    """How much the words say that this is not the plain measurement: 2 each, 1 for a motor's side of a gear; the lowest is taken."""
    group: str
    """The words that are neither quantity nor axis: columns of one sensor share them."""
    is_roll: bool = False
    """Whether the name says roll (or tilt, lean, heel, bank), not merely some angle."""


def says_counts(name: str) -> bool:
    """Return whether a column's name, with what stands in its brackets, says that it counts: 'encoder_ticks', 'position [counts]'."""
    return bool(_COUNT_WORDS & set(_words(name)))


def parse_unit(text: str) -> str | None:
    """Return the unit's standard spelling, or None for an unknown unit."""
    plain = re.sub(r"\s+", " ", text.strip().strip("[](){}").strip().lower())
    return _UNITS.get(plain) or _UNITS.get(plain.replace("_", " ").replace("*", " "))


def unit_kind(unit: str | None) -> Kind:
    """Return the quantity that a unit measures."""
    return _UNIT_KIND.get(unit or "", "unknown")


def parse_column(name: str, unit: str | None = None) -> Column:
    """Return what a column's name says; `unit` comes from a row of units below the header, if there is one."""
    label, in_brackets = _split_brackets(name)
    words = _words(label)
    found = (parse_unit(unit) if unit else None) or (parse_unit(in_brackets) if in_brackets else None)
    if found is None:
        words, found = _split_unit(words)
    if clock := _CLOCKS.get(" ".join(words)):
        return Column(name, "time", "", clock, 0, "")
    if index := re.search(r"\[([0-3])\]", name):
        words = _indexed(words, int(index[1]))
    leaf = _split_unit(_words(re.split(r"[/.]", label)[-1]))[
        0
    ]  # the group before it is no quantity: 'enc/t', 'roll_time'
    clocks = _TIME_WORDS - _COUNT_WORDS
    named = set(leaf) <= clocks or (leaf[-1:] and len(leaf[-1]) > 2 and leaf[-1] in clocks)
    kind = "time" if named else _kind(words, found)
    if kind == "rate" and unit_kind(found) == "angle":
        found = f"{found}/s"  # 'gyro_x_rads' and 'gyro_deg'
    if found is not None and kind != "std" and unit_kind(found) != kind:
        found = None
    axis = _axis(words, kind)
    doubt = 2 * sum(word in _DOUBTFUL for word in words) + bool(_DRIVING & set(words))
    doubt += 2 * (kind == "angle" and _computed(set(words)))
    group = " ".join(word for word in words if word not in _KNOWN_WORDS)
    return Column(name, kind, axis, found, doubt, group, bool(_ROLL_WORDS & set(words)))


def _indexed(words: list[str], index: int) -> list[str]:
    """Return the words of a vector's part with its axis: gyro[0] is x, q[0] w."""
    rest = [word for word in words if word != str(index)]
    if not _VECTORS & set(rest):
        return words
    return [*rest, "wxyz"[index] if _QUATERNION_WORDS & set(rest) else "xyzw"[index]]


def sensor_of(table: str) -> str:
    """Return the words in the name of a table: 'Total Acceleration' of TotalAcceleration.csv."""
    return " ".join(re.findall(r"[A-Z]?[a-z]+|[A-Z]+", table)) or table


def of_sensor(table: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return column names with the sensor's before bare axes, where only the name of the table says it: Gyroscope.csv of x, y, z."""
    columns, sensor_name = [parse_column(name) for name in names], sensor_of(table)
    sensor = parse_column(f"{sensor_name} x")
    if sensor.kind not in ("rate", "accel") or any(
        column.kind in ("rate", "accel", "angle") for column in columns
    ):
        return tuple(names)
    return tuple(f"{sensor_name} {c.name}" if c.kind == "unknown" and c.axis else c.name for c in columns)


def stem_of_clock(column: Column) -> tuple[str, ...]:
    """Return the words of a time's name without its unit: two columns that share them may be parts of one clock."""
    return tuple(
        word for word in _words(_split_brackets(column.name)[0]) if unit_kind(_UNITS.get(word)) != "time"
    )


def _split_brackets(name: str) -> tuple[str, str]:
    match = re.fullmatch(r"\s*(.*?)\s*[\(\[\{]([^\)\]\}]*)[\)\]\}]\s*", name)
    if match and match[1]:
        return match[1], match[2]
    head, _, tail = name.rpartition("/")  # 'roll / deg'; but also '/imu/angular_velocity/x'
    if head.strip() and parse_unit(tail) and not parse_unit(f"{head.split()[-1]}/{tail}"):
        return head, tail
    return name, ""


def _words(label: str) -> list[str]:
    label = re.sub(
        r"([^\W\d_\x00-\x7fµμ])(?=[A-Za-z]\b)",
        r"\1 ",
        _SYMBOL.sub(lambda letter: _GREEK[letter[0]], _plain(label)),
    )  # 角速度x
    label = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", label)
    words: list[str] = []
    for word in re.split(r"[^\w°²]+|_", label.lower()):
        glued = _GLUED.fullmatch(word)
        if numbered := re.fullmatch(r"(?:q|quat|quaternion)([0-3])", word):
            words += ["quat", "wxyz"[int(numbered[1])]]
        elif (counted := re.fullmatch(r"([a-z]{3,})(\d)", word)) and counted[1] in _KNOWN_WORDS:
            words += [counted[1], counted[2]]
        elif glued:
            words += [_GLUED_WORD.get(glued[1], glued[1]), glued[2]]
        elif word:
            words.append(word)
    return words


def _split_unit(words: list[str]) -> tuple[list[str], str | None]:
    """Take the unit off the name: the longest run of words that is one, last in the name first."""
    for length in (3, 2, 1):
        for start in range(len(words) - length, -1, -1):
            text = " ".join(words[start : start + length])
            unit = _UNITS.get(text)
            # A lone letter is a unit only at the end, behind a word ('t_s', 'acc_x_g'); a lone m may be a motor's.
            lone = start > 0 and start + length == len(words) and (text != "m" or words[start - 1] in _PLACES)
            if unit and text != "in" and (len(text) > 1 or lone):
                rest = words[:start] + words[start + length :]
                return (rest if rest else words), unit
    return words, None


def _kind(words: list[str], unit: str | None) -> Kind:
    found = set(words)
    if found & _STD_WORDS:
        return "std"
    if words[:1] and words[0] in _TIME_WORDS and unit_kind(unit) == "time":
        return "time"
    if found & _OTHER_WORDS:
        return "other"
    if _computed(found) and unit_kind(unit) in ("angle", "unknown"):
        return "angle"
    if unit_kind(unit) == "angle" and found & _RATE_WORDS:
        return "rate"
    if unit_kind(unit) in ("rate", "accel", "angle", "length", "speed"):
        return unit_kind(unit)
    if found & {"pos", "position"} and found & {"x", "y"}:
        return "length"
    if found & _QUATERNION_WORDS and found & set("xyzw"):
        return "quaternion"
    for kind, vocabulary in (("accel", _ACCEL_WORDS), ("rate", _RATE_WORDS), ("angle", _ANGLE_WORDS)):
        if found & vocabulary:
            return kind  # type: ignore[return-value]
    if found & _TIME_WORDS or unit_kind(unit) == "time":
        return "time"
    return "unknown"


def _computed(words: set[str]) -> bool:
    """Return whether words, each without unit, say an angle that was computed from one sensor."""
    sensors, others = words & (_GYRO_WORDS | _ACCEL_WORDS), words & (_RATE_WORDS - _GYRO_WORDS)
    return bool(sensors and words & _COMPUTED_WORDS) and not others


def _axis(words: list[str], kind: Kind) -> str:
    if kind in ("angle", "rate", "std"):
        for axis, names in (("x", _ROLL_WORDS), ("y", {"pitch"}), ("z", {"yaw", "heading", "psi"})):
            if names & set(words):
                return axis
    letters = [word for word in words if word in ("x", "y", "z", "w")]
    return letters[-1] if letters else ""
