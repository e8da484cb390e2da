"""Which way imports point, and what importing the library costs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LIMIT = 0.060
"""Longest time that `import sysid` may take [s]."""


def test_imports_point_one_way():
    pytest.importorskip("importlinter")
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]


def test_importing_the_library_costs_nothing():
    code = (
        "import sys, time; start = time.perf_counter(); import sysid; took = time.perf_counter() - start\n"
        "assert 'numpy' not in sys.modules; print(took)"
    )
    runs = [
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
        for _ in range(5)
    ]
    assert all(run.returncode == 0 for run in runs), runs[0].stderr
    assert min(float(run.stdout) for run in runs) < LIMIT
