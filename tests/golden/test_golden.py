"""Every command gives what it gave.

On one machine the same code gives the same twelve digits: after `python tests/golden/regenerate.py`,
`git diff tests/golden` is the exact comparison. Here numbers may differ by a millionth, as another processor sums
in another order: without FMA and AVX2 a sample of a synthetic log is rounded the other way now and then, which
moves what is fitted to it by up to 5e-7 of itself, angles near zero by 1.3e-10 rad. Text is compared exactly.
"""

import shutil
from pathlib import Path

import pytest
from golden_cases import FILMED, STORE, cases, differences, machine, make_logs, read, run

RTOL, ATOL = 1e-6, 2e-10


@pytest.fixture(scope="module")
def here() -> dict[str, str]:
    return machine()


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    pytest.importorskip("mcap.writer", reason="the mcap extra is not installed")
    folder = tmp_path_factory.mktemp("golden").resolve()
    make_logs(folder)
    return folder


@pytest.fixture(scope="module")
def filmed(tmp_path_factory, film_of) -> Path:
    folder = tmp_path_factory.mktemp("golden-films").resolve()
    (folder / "logs").mkdir()
    for name in FILMED:
        shutil.copy(film_of(Path(name).stem).path, folder / "logs")
    return folder


def marked(case):
    return pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.slow else [])


@pytest.mark.parametrize("case", [marked(case) for case in cases()])
def test_as_before(case, here, request):
    if case.needs and here[case.needs] != read("machine")[case.needs]:
        what = {"mujoco": "with another version of MuJoCo", "film": "where films are drawn otherwise, or not"}
        pytest.skip(f"the digits were stored {what[case.needs]}")
    folder = request.getfixturevalue("filmed" if case.needs == "film" else "logs")
    found = list(differences(read(case.name), run(case, folder), rtol=RTOL, atol=ATOL))
    assert not found, "\n".join(found)


def test_the_store_holds_the_cases_and_nothing_else():
    assert {path.stem for path in STORE.glob("*.json")} == {"machine", *(case.name for case in cases())}
