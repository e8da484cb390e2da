"""Every command on logs, records, options and policies that nobody should give it, each in a process of its own.

    python benchmarks/fuzz_commands.py --cases 0:5000 --jobs 16 --out fuzz.jsonl
    python benchmarks/fuzz_commands.py --cases 0:1000000 --minutes 20 --jobs 16 --out fuzz.jsonl
    python benchmarks/fuzz_commands.py --cases 4711 --keep /tmp/case    # one case again, with its files

A case is made from its number alone. It is right if the command ends within 30 s, with at most 2 GB more than Python and
its packages take, with an exit code that the help names and, where that is no 0, one line that says why; if it writes
nowhere but into its workspace and where its options say, leaves no temporary file and no process, every file that it
reads as it was, and a board's record whole and in `undo`. A share of the cases is broken off by a signal or a full disk.
Of logs with a known truth, stiffness and damping must lie within three of their 95 % intervals in 99.5 % of those that
are accepted, and within one in 93 to 97 %.

One line of JSON a case goes to --out, in which cases that are there already are not run again; the last line printed
is the summary. Exit code 1 if anything was wrong. Needs Linux (pidfd, fork), no network and no test extras; a case whose
command misses a package that is not installed is counted as skipped, with the package's name.
"""

import argparse
import hashlib
import io
import json
import math
import os
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_inputs import (  # fmt: skip
    WRITTEN,
    Truth,
    damaged,
    damaged_record,
    drawn_board,
    hostile_policy,
    log_with_truth,
    odd_options,
)

from sysid.board import load_board, save_board
from sysid.cli import COMMANDS, build_app, main
from sysid.errors import SysidError

LIMIT = 30.0
"""Longest time of a command [s]."""
MEMORY = 2 << 30
"""Most that a command may take beyond what was loaded before it began [B]."""
LOG_COMMANDS = ("decay", "roll", "fit", "compare", "check", "diagnose", "report", "view")
LOG_SHARES = (0.4, 0.2, 0.1, 0.1, 0.06, 0.06, 0.04, 0.04)
KINDS = {"truth": 0.4, "log": 0.25, "record": 0.13, "option": 0.13, "policy": 0.03, "broken-off": 0.06}
"""Kinds of cases and their shares."""
NOT_RUN = ("train", "live")
"""They take hours, and wait for a phone."""
BOARD = ("--board", "mine", "--workspace", "ws")


@dataclass
class Case:
    """A command line and the folder that it runs in."""

    number: int
    kind: str
    folder: Path
    arguments: list[str]
    truth: Truth | None = None
    policy: Path | None = None
    """Opened instead of running a command: a ride opens it after a robot that is not everywhere."""
    end_after: tuple[float, int] | None = None
    """Broken off so many seconds after its start, by this signal."""
    largest_file: int | None = None
    """As of a disk that is full [B]."""


@dataclass
class Result:
    """What is said of a case in one line of JSON."""

    number: int
    kind: str
    command: list[str]
    code: int
    seconds: float
    cpu: float
    """Of the command and the processes that it waited for [s]."""
    memory_mb: float
    said: str
    problems: list[str]
    deviations: dict[str, float] = field(default_factory=dict[str, float])
    """(value - truth) / half its 95 % interval, of logs with a known truth that were accepted."""
    skipped: str = ""
    """Why nothing is judged: a package that the command needs is not installed here."""


def make_case(number: int, folder: Path) -> Case:
    """Write the files of a case."""
    rng = np.random.default_rng([number, 19])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    for name in ("in", "out", "ws/data/boards", "tmp", "home"):
        (folder / name).mkdir(parents=True)
    board = drawn_board(rng)
    record = folder / "ws/data/boards/mine.toml"
    save_board(board, record)
    command = str(rng.choice(LOG_COMMANDS, p=LOG_SHARES))
    log, truth = log_with_truth(rng, folder / "in", board, quick=kind != "truth")
    name = f"in/{log.name}"
    case = Case(number, kind, folder, [])
    files = {"roll": "out/roll.csv", "view": "out/view.rrd", "report": "out/report.html"}
    output = {command: ("-o", file) for command, file in files.items()}
    usual = (*BOARD, *output.get(command, ())) if command != "roll" else output["roll"]
    usual = (*usual, "--workers", "1") if command == "diagnose" else usual
    if kind == "truth":
        case.truth = truth
        case.arguments = ["decay", name, *BOARD, "--no-picture", "--json", "out/result.json"]
    elif kind == "log":
        log.write_bytes(damaged(rng, log.read_bytes()))
        if rng.random() < 0.3:
            suffix = str(rng.choice(["", ".txt", ".parquet", ".mcap", ".zip", ".mp4", ".mat"]))
            log = log.rename(log.with_suffix(suffix))
        case.arguments = [command, f"in/{log.name}", *usual]
    elif kind == "record":
        record.write_bytes(damaged_record(rng, board))
        chosen = str(rng.choice(["mjcf", "boards", "history", "undo", "synth", command, command]))
        rest = {
            "mjcf": (*BOARD, "-o", "out/mine.xml", *(("--bench",) if rng.random() < 0.5 else ())),
            "boards": (*(("mine",) if rng.random() < 0.5 else ()), "--workspace", "ws"),
            "history": BOARD,
            "undo": BOARD,
            "synth": (*BOARD, "-o", "out/log.csv", "--rate", "200"),
        }.get(chosen, (name, *usual))
        case.arguments = [chosen, *rest]
    elif kind == "option":
        case.arguments = _odd_command(rng, folder, log, usual)
    elif kind == "policy":
        case.policy = folder / "in/policy.onnx"
        case.policy.write_bytes(hostile_policy(rng))
        case.arguments = ["play", "in/policy.onnx", *BOARD]
    else:
        command = str(rng.choice(["decay", "fit", "check", "report", "view", "mjcf", "roll"]))
        others = {
            "roll": output["roll"],
            "view": (*BOARD, *output["view"]),
            "mjcf": (*BOARD, "-o", "out/mine.xml"),
        }
        rest = others.get(command, BOARD)
        case.arguments = [command, *((name,) if command != "mjcf" else ()), *rest]
        if rng.random() < 0.6:
            number_of = int(rng.choice([signal.SIGINT, signal.SIGTERM, signal.SIGKILL]))
            case.end_after = float(rng.choice([rng.uniform(0, 0.05), rng.uniform(0, 2)])), number_of
        else:
            case.largest_file = int(rng.choice([0, 100, 1000, 5000, 100_000]))
    return case


def _odd_command(rng: np.random.Generator, folder: Path, log: Path, usual: Sequence[str]) -> list[str]:
    """Return any command with odd options, and put files into the case that they may name."""
    inside = folder / "in"
    (inside / "log").write_bytes(log.read_bytes())
    (inside / "empty").touch()
    os.mkfifo(inside / "fifo")
    (inside / "link").symlink_to("log")
    (inside / "loop").symlink_to("loop")
    (inside / "fifo_read").symlink_to("/dev/null")
    app = build_app()
    command = str(rng.choice([c for c in COMMANDS if c not in NOT_RUN]))
    words, found = [command], app[command]
    if COMMANDS[command].has_parts:
        part = str(rng.choice([n for n in found if not n.startswith("-")]))
        words, found = [command, part], found[part]
    arguments = [(tuple(a.names), a.hint) for a in found.assemble_argument_collection()]
    names = {n for own, _ in arguments for n in own}
    if any(n and not n[0].startswith("-") for n, _ in arguments):
        logs = [f"in/{log.name}", f"in/{log.name}", "in/none", "in/fifo", "mine", "/dev/zero"]
        words.append(str(rng.choice(logs)))
    if "--board" in names:
        boards = ["mine", "mine", "mine", "pink", "../../x", "", "/dev/null", "a" * 300, "MINE"]
        words += ["--board", str(rng.choice(boards))]
    odd = list(odd_options(rng, arguments))
    if "--output" in names and not {"-o", "--output"} & set(odd):
        ends = {"synth": ".csv", "mjcf": ".xml", "view": ".rrd", "marker": ".png"}
        words += ["-o", f"out/made{ends.get(command, '')}"]
    if command == "diagnose":
        words += ["--workers", "1"]
    if command == "run" and "--duration" in names and "--duration" not in odd:
        words += ["--duration", "0.1"]
    return [*words, *odd, "--workspace", "ws"]


# Running


def run_case(case: Case, limit: float) -> Result:
    """Run a case in a fork of this process, which has loaded what commands load, and judge what it left."""
    before = _contents(case.folder)
    (case.folder / "stderr").touch()  # a signal may come before the child opens it
    begin = time.monotonic()
    child = os.fork()
    if child == 0:
        _be_the_command(case)
    fd, timed_out = os.pidfd_open(child), False
    if case.end_after is not None and not select.select([fd], [], [], case.end_after[0])[0]:
        os.kill(child, case.end_after[1])
    while not select.select([fd], [], [], max(0.0, limit - (time.monotonic() - begin - _starved(child))))[0]:
        if time.monotonic() - begin - _starved(child) >= limit:
            timed_out = True
            os.killpg(child, signal.SIGKILL)
            break
    os.close(fd)
    _, status, usage = os.wait4(child, 0)
    seconds = time.monotonic() - begin
    error = (case.folder / "stderr").read_text(errors="replace")
    lines = [line for line in error.splitlines() if line.strip()]
    result = Result(
        number=case.number, kind=case.kind, command=case.arguments, code=os.waitstatus_to_exitcode(status),
        seconds=round(seconds, 2), cpu=round(usage.ru_utime + usage.ru_stime, 2), memory_mb=round(usage.ru_maxrss / 1024), said=lines[-1][:200] if lines else "",
        problems=[f"no end within {limit:g} s"] if timed_out else [],
    )  # fmt: skip
    if _lives_on(child) and not timed_out:
        result.problems.append("left a process")
    if package := _missing(result.said):
        result.skipped, result.problems = f"needs the package {package}", []
    elif not timed_out:
        result.problems += [*_said_wrong(case, result, error), *_left_wrong(case, result, before)]
    if case.truth is not None and result.code == 0:
        result.deviations = _deviations(case, case.truth)
    return result


def _lives_on(group: int) -> bool:
    """Return whether a process of a group is there a second after its first one, and end it.

    Python's tracker of shared resources ends by itself, a moment after the process that it served.
    """
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.01)
    os.killpg(group, signal.SIGKILL)
    return True


def _starved(process: int) -> float:
    """Return how long a process waited for a processor that others used [s]; 0 where the kernel does not count it."""
    path = Path(f"/proc/{process}/schedstat")
    return 1e-9 * int(path.read_text().split()[1]) if path.exists() else 0.0


def _missing(said: str) -> str:
    """Return the package that a traceback's last line misses, if this machine has none of that name."""
    found = re.fullmatch(r"ModuleNotFoundError: No module named '(\w+).*'", said)
    return found[1] if found and find_spec(found[1]) is None else ""


def _be_the_command(case: Case) -> None:
    """Become the command: its folder, streams, limits and arguments; never returns."""
    code, began = 70, False
    try:
        os.setpgid(0, 0)
        os.chdir(case.folder)
        os.environ |= {"HOME": str(case.folder / "home"), "TMPDIR": str(case.folder / "tmp"), "NO_COLOR": "1"}
        tempfile.tempdir = None
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), number)
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), encoding="utf-8", line_buffering=True)
        sys.stderr = io.TextIOWrapper(io.FileIO(2, "w", closefd=False), encoding="utf-8", line_buffering=True)
        loaded = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (loaded + MEMORY, loaded + MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.dont_write_bytecode = True
        _watch(case.folder)
        sys.argv = ["husky-sysid", *case.arguments]
        if case.largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (case.largest_file, case.largest_file))
        began = True
        try:
            _open(case.policy) if case.policy else main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException as error:  # noqa: BLE001  the fork must not go on as its parent
        if began or not isinstance(error, KeyboardInterrupt):
            traceback.print_exc()
        else:
            code = 130  # broken off before the command began
    finally:
        os._exit(code)


def _open(policy: Path) -> None:
    from policy_runtime.loop.policy_file import open_policy

    try:
        open_policy(policy, load_board(Path("ws/data/boards/mine.toml")))
    except SysidError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(error.exit_code) from None


def _watch(folder: Path) -> None:
    """Note on standard error whatever is written outside the case's folder."""
    writing = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
    paths = {"os.rename": (0, 1), "os.remove": (0,), "os.mkdir": (0,), "os.link": (1,), "os.symlink": (1,),
             "os.chmod": (0,), "os.rmdir": (0,), "os.truncate": (0,), "shutil.rmtree": (0,)}  # fmt: skip

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            touched = [arguments[0]] if arguments[2] & writing else []
        else:
            touched = [arguments[place] for place in paths.get(event, ())]
        for path in touched:
            if isinstance(path, str | bytes | os.PathLike):
                where = os.path.realpath(os.fsdecode(path))
                known = where.startswith((f"{folder}/", "/dev/", "/proc/"))
                if not known and not (event == "os.mkdir" and os.path.isdir(where)):  # noqa: PTH112
                    os.write(2, f"OUTSIDE {event} {where}\n".encode())

    sys.addaudithook(hook)


def _contents(folder: Path) -> dict[str, str]:
    """Return what each file of a case is: its digest, or what a link points to."""
    found: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_symlink():
            found[name] = f"-> {path.readlink()}"
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        elif not path.is_dir():
            found[name] = "special"
    return found


def _said_wrong(case: Case, result: Result, error: str) -> Iterator[str]:
    """Yield what is wrong with how a command ended."""
    if case.end_after is not None and result.code in (-case.end_after[1], 130, 143):
        if "Traceback" in error:
            yield "traceback"
        return
    if result.code not in (0, 1, 2, 3):
        yield f"exit code {result.code}"
    if "Traceback" in error:
        yield "traceback"
    if "Warning: " in error:
        yield "a warning of Python"
    if "OUTSIDE" in error:
        yield "wrote outside: " + next(line for line in error.splitlines() if "OUTSIDE" in line)
    mute = case.largest_file is not None  # the disk is as full for standard error
    if result.code in (1, 3) and not result.said.startswith("error: ") and not mute:
        yield "no word on why"
    if result.code == 0 and "--json" in case.arguments:
        name = case.arguments[case.arguments.index("--json") + 1]
        path = case.folder / (name if name != "-" else "stdout")
        if path.is_file() and not name.startswith("/dev"):
            try:
                json.loads(path.read_text(), parse_constant=_no_number)
            except ValueError as why:
                yield f"JSON: {why}"


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is no JSON")


def _left_wrong(case: Case, result: Result, before: dict[str, str]) -> Iterator[str]:
    """Yield what is wrong with the files that a command left."""
    after = _contents(case.folder)
    killed = result.code == -signal.SIGKILL
    record = "ws/data/boards/mine.toml"
    words = case.arguments
    asked = {os.path.realpath(case.folder / word) for option, word in pairwise(words) if option in WRITTEN}
    asked -= {os.path.realpath(case.folder / word) for word in words[1:2]}  # what it reads
    for name, content in before.items():
        changed = name != record and after.get(name) != content
        if changed and os.path.realpath(case.folder / name) not in asked:
            yield f"changed {name}"
    for name in after.keys() - before.keys():
        place = name.startswith(("out/", "ws/reports/", "ws/data/boards/")) or name in ("stdout", "stderr")
        hidden = Path(name).name.startswith(".")
        if "/matplotlib/" in name:  # its fonts, kept in the home folder of whoever draws
            continue
        if (not place or hidden) and not killed:
            yield f"left {name}"
    if before[record] != after.get(record):
        earlier = [content for name, content in after.items() if "/.earlier/" in name]
        if before[record] not in earlier and "undo" not in case.arguments:
            yield "the record was changed, and its old state is nowhere"
        if result.code == 1:
            yield "the record was changed by a command that failed"
        try:
            load_board(case.folder / record)
        except SysidError as error:
            yield f"the record is broken: {error}"


def _deviations(case: Case, truth: Truth) -> dict[str, float]:
    found = json.loads((case.folder / "out/result.json").read_text())
    result: dict[str, float] = {}
    for name in ("stiffness", "damping"):
        low, high = found[name]["ci95"]
        result[name] = round(2 * (found[name]["value"] - getattr(truth, name)) / (high - low), 4)
    return result


def _load() -> None:
    """Load what commands load, once."""
    import casadi  # noqa: F401
    import mujoco  # noqa: F401
    import pandas  # noqa: F401
    import scipy.optimize
    import scipy.signal  # noqa: F401

    import sysid.free_decay
    import sysid.video_roll  # noqa: F401

    for name in COMMANDS:
        if name not in NOT_RUN and not COMMANDS[name].has_parts:
            build_app()[name].assemble_argument_collection()


def work(number: int, limit: float, keep: str | None) -> dict[str, Any]:
    """Make, run and judge one case."""
    folder = Path(keep) if keep else Path(tempfile.mkdtemp(prefix="fuzz-")).resolve()
    try:
        return vars(run_case(make_case(number, folder), limit))
    except Exception as error:  # noqa: BLE001  what is wrong with the benchmark itself is said of its case
        traceback.print_exc()
        return vars(Result(number, "benchmark", [], 70, 0, 0, 0, repr(error), [f"benchmark: {error!r}"]))
    finally:
        if not keep:
            shutil.rmtree(folder, ignore_errors=True)


def summary(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Count what came out of all cases."""
    wrong = [line for line in lines if line["problems"]]
    deviations = np.abs([d for line in lines for d in line["deviations"].values()])
    truths = [line for line in lines if line["kind"] == "truth"]

    def share(most: float) -> float:
        return round(float(np.mean(deviations <= most)), 5) if len(deviations) else math.nan

    return {
        "cases": len(lines),
        "kinds": dict(Counter(line["kind"] for line in lines)),
        "codes": {str(k): v for k, v in sorted(Counter(line["code"] for line in lines).items())},
        "wrong": len(wrong),
        "problems": dict(Counter(p.split(":")[0].split(" /")[0][:60] for line in wrong for p in line["problems"]).most_common()),
        "slowest_s": max((line["seconds"] for line in lines), default=0),
        "most_memory_mb": max((line["memory_mb"] for line in lines), default=0),
        "skipped": dict(Counter(line["skipped"] for line in lines if line["skipped"])),
        "known_truth": len(truths),
        "accepted": sum(bool(line["deviations"]) for line in truths),
        "within_three_intervals": share(3),
        "within_one_interval": share(1),
    }  # fmt: skip


def _seeds(text: str) -> range:
    first, _, last = text.partition(":")
    return range(int(first), int(last) if last else int(first) + 1)


def run() -> int:
    """Run the cases that are asked for and not in the file yet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=_seeds, default=range(200), help="FIRST:LAST, or one")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--minutes", type=float, default=math.inf, help="start no case after so long")
    parser.add_argument("--limit", type=float, default=LIMIT, help="longest time of a command [s]")
    parser.add_argument("--out", type=Path, default=None, help="JSON lines; what is there is not run again")
    parser.add_argument("--keep", default=None, help="folder in which the files of a single case stay")
    options = parser.parse_args()
    lines: list[dict[str, Any]] = []
    if options.out is not None and options.out.exists():
        lines = [json.loads(line) for line in options.out.read_text().splitlines()]
    done = {line["number"] for line in lines}
    waiting = iter([n for n in options.cases if n not in done])
    end = time.monotonic() + 60 * options.minutes
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    _load()
    out = options.out.open("a") if options.out else None
    import multiprocessing

    with ProcessPoolExecutor(options.jobs, mp_context=multiprocessing.get_context("fork")) as pool:
        running: set[Any] = set()
        while True:
            while len(running) < 2 * options.jobs and time.monotonic() < end:
                number = next(waiting, None)
                if number is None:
                    break
                running.add(pool.submit(work, number, options.limit, options.keep))
            if not running:
                break
            ready, running = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                line = future.result()
                lines.append(line)
                if out:
                    out.write(json.dumps(line) + "\n")
                    out.flush()
                worst = max(map(abs, line["deviations"].values()), default=0)
                if line["problems"] or worst > 3 or options.keep:
                    print(json.dumps(line), flush=True)
    found = summary(lines)
    print(json.dumps(found))
    return int(found["wrong"] > 0 or found["within_three_intervals"] < 0.995)


if __name__ == "__main__":
    sys.exit(run())
