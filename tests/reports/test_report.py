"""The page of a board: whole, self-contained, and working in a real browser with the network off."""

import html
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from command_line import called
from decay_truth import Recipe, make_roll, write_log

from reports.figures.svg import MOST_POINTS, thin
from reports.page.page import Page, choices, table
from sysid.board import Board
from sysid.workspace import Workspace

REPORTS = Path(__file__).parents[2] / "reports"


def rocked(path, **recipe):
    """A log of three releases."""
    return write_log(path, make_roll(Recipe(**{"sampling": 400, "amplitudes": (0.2, -0.15, 0.18), **recipe})))


def reported(folder, *words, board="pink"):
    """The page that `report` writes of a board in a workspace, as text."""
    called("report", *words, "-b", board, "--workspace", folder)
    return html.unescape((folder / "reports" / board / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def space(tmp_path_factory):
    """A workspace in which pink was fitted with dry friction to a log that has it."""
    folder = tmp_path_factory.mktemp("space")

    def law(angle, rate):
        return -1687.9 * angle - 12.0 * rate - 6.0 * np.tanh(rate / 1e-3)

    log = rocked(folder / "rock.csv", law=law)
    (folder / "rock.truth.json").write_text('{"synthetic": true}')
    called("fit", log, "-b", "pink", "--effect", "coulomb", "--workspace", folder)
    called("report", "-b", "pink", "--workspace", folder)
    return folder


@pytest.fixture(scope="module")
def page(space):
    return space / "reports" / "pink" / "report.html"


def test_the_page_stands_alone_and_is_small(page):
    text = page.read_text(encoding="utf-8")
    assert len(text.encode()) < 1e6
    outside = [link for link in re.findall(r'(?:src|href)="([^"]+)"', text) if link[0] != "#"]
    assert outside == ["data:,"]
    assert not re.findall(r"@import|url\((?!#)", text)
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]+"', "", text)


def test_the_page_holds_what_the_record_and_the_logs_say(space, page):
    text = page.read_text(encoding="utf-8")
    sections = re.findall(r"<h2>(.*?)</h2>", text)
    assert {"How it came here", "Parameters", "Identified law", "Measured against simulated"} < set(sections)
    digest = Board.load("pink", space).fit["logs"][0]["sha256"]
    for said in (digest, "as fitted", "sgn φ̇", "These logs are synthetic"):
        assert said in text
    words = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r">[^<]*\d\.\d{9,}[^<]*<", words), "a number with nine digits"
    assert str(space / "data") not in text  # paths are as seen from the workspace


def test_a_changed_log_and_a_gone_one_are_said(space, tmp_path, capsys):
    copy = shutil.copytree(space, tmp_path / "copy")
    record, log = copy / "data" / "boards" / "pink.toml", copy / "rock.csv"
    record.write_text(record.read_text().replace(str(space / "rock.csv"), "rock.csv"))
    log.write_text(log.read_text() + "99.0,0.0\n")
    text = reported(copy)
    assert "rock.csv: changed since the fit" in text
    assert "Measured against simulated" not in text
    log.unlink()
    text = reported(copy)
    assert "rock.csv: gone" in text
    assert "coulomb: torque" in text
    assert "gone" in capsys.readouterr().err


def test_a_shipped_board_is_reported_from_logs_that_are_given(tmp_path):
    text = reported(tmp_path, rocked(tmp_path / "rock.csv", sampling=250, amplitudes=(0.2,)))
    assert "not part of the recorded fit" in text
    assert "as shipped with the tool" in text


def test_thinning_keeps_every_extreme():
    rng = np.random.default_rng(1)
    time = np.linspace(0, 600, 300_000)
    curve = rng.normal(0, 1, len(time))
    curve[[777, 200_001]] = 40, -40
    x, y = thin(time, curve)
    assert len(x) <= MOST_POINTS + 2
    assert (y.min(), y.max()) == (-40, 40)
    assert np.all(np.diff(x) > 0)


def test_texts_are_escaped():
    page = Page("a <b>", "c & d")
    page.section("<e>", table(["<f>"], [["<g>"]]), choices([("<h>", "x"), ("i", "y")]))
    text = page.render()
    for raw in ("<b>", "<e>", "<f>", "<g>", "<h>"):
        assert raw not in text.split("</style>")[1].split("<script>")[0]


# In a real browser.


@pytest.fixture(scope="module")
def tab(page, chromium):
    size(chromium, 1000, 900)
    chromium.open(page)
    return chromium


def size(tab, width, height):
    how = {"deviceScaleFactor": 1, "mobile": width < 500}
    tab.call("Emulation.setDeviceMetricsOverride", width=width, height=height, **how)


def test_the_browser_has_no_complaint_and_asks_for_nothing(tab):
    assert tab.complaints == []
    assert [url for url in tab.asked if not url.startswith(("file:", "data:"))] == []


def test_every_figure_has_drawn_content(tab):
    sizes = tab.run(
        "[...document.querySelectorAll('svg.figure')].filter(s => s.getClientRects().length)"
        ".map(s => [s.id, s.getBoundingClientRect().width, s.getBoundingClientRect().height,"
        " Math.max(0, ...[...s.querySelectorAll('path')].map(p => p.getBBox().width))])"
    )
    figures = {"release1", "story-decay", "story-ladder", "story-whiteness"}
    assert figures <= {name for name, *_ in sizes}
    for name, width, height, drawn in sizes:
        assert (width > 200, height > 100, drawn > 20) == (True, True, True), name


def test_labels_of_a_figure_do_not_collide(tab):
    """Texts of one axis may touch, but none covers another."""
    covered = tab.run(
        """(() => {
        const bad = [];
        for (const svg of document.querySelectorAll('svg.figure')) {
          if (!svg.getClientRects().length) continue;
          const upright = [...svg.querySelectorAll('text')].filter(t => !/rotate\\(-(?!0\\b)/.test(
            t.getAttribute('transform') || ''));
          const boxes = upright.map(t => [t.textContent, t.getBoundingClientRect()]);
          boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => {
            const x = Math.min(p.right, q.right) - Math.max(p.left, q.left);
            const y = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
            if (x > 3 && y > 5) bad.push(`${svg.id}: ${a} / ${b}`);
          }));
        }
        return bad;
        })()"""
    )
    assert covered == []


def test_releases_are_switched(tab):
    def shown():
        return tab.run(
            "['release1', 'release2', 'release3'].filter(n => document.getElementById(n).getClientRects().length)"
        )

    assert shown() == ["release1"]
    tab.run("document.querySelector('[data-shows=\"release 2\"]').click()")
    assert shown() == ["release2"]
    tab.run("document.querySelector('[data-shows=\"release 1\"]').click()")


WIDTHS = {1400: 900, 390: 844}
"""Of a desk and of a phone, with the height of their first screens [px]."""
READABLE = """(() => {
  const luminance = (colour) => {
    const parts = colour.match(/[\\d.]+/g).slice(0, 3).map((v) => v / 255)
      .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
  };
  const behind = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const colour = getComputedStyle(e).backgroundColor;
      if (!/, 0\\)$|transparent/.test(colour)) return colour;
    }
  };
  const bad = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || element.closest("script, style, noscript") || !element.getClientRects().length) continue;
    const style = getComputedStyle(element), drawn = element instanceof SVGElement;
    const [one, other] = [luminance(drawn ? style.fill : style.color), luminance(behind(element))].sort((a, b) => b - a);
    const size = parseFloat(style.fontSize) * (drawn ? Math.hypot(element.getScreenCTM().a, element.getScreenCTM().b) : 1);
    const what = `${element.tagName} ${walker.currentNode.data.trim().slice(0, 30)}`;
    if ((one + 0.05) / (other + 0.05) < 4.5) bad.push(`contrast: ${what}`);
    if (size < 10.99) bad.push(`${size} px: ${what}`);
  }
  return bad;
})()"""


@pytest.fixture(params=WIDTHS, ids=str)
def sized(tab, request):
    """The page at one width."""
    size(tab, request.param, WIDTHS[request.param])
    tab.run("scrollTo(0, 0)")
    yield tab
    size(tab, 1000, 900)
    tab.dark(False)


@pytest.mark.parametrize("dark", [False, True])
def test_every_text_is_readable(sized, dark):
    sized.dark(dark)
    sized.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))")
    assert sized.run(READABLE) == []
    assert sized.run("document.documentElement.scrollWidth <= innerWidth")


def test_the_first_screen_answers_four_questions(sized):
    rows = sized.run(
        "[...document.querySelectorAll('.answers div')].map(e => "
        "[e.children[0].textContent, e.children[1].textContent, e.getBoundingClientRect().bottom <= innerHeight])"
    )
    assert [row[0] for row in rows] == [
        "Does the model match?", "What is missing?", "How sure is that?", "What to do next?",
    ]  # fmt: skip
    assert all(row[2] for row in rows)
    assert rows[0][1].startswith("✓ Yes")
    assert rows[1][1] == "Not asked yet."
    assert "husky-sysid diagnose" in rows[3][1]


def diagnosed(board, **changes):
    """What diagnose.json holds, as far as the page reads it."""
    verdict = {
        "status": "missing", "effects": ["coulomb"], "confidence": 0.9, "explanation": "It sticks.", "next_experiment": "",
    }  # fmt: skip
    candidate = {
        "effects": ["coulomb"], "score": 0.0, "rmse_rad": 1e-3, "heldout_rmse_rad": 1e-3,
        "parameters": {n: {"value": v} for n, v in (("stiffness", 14.7), ("damping", 0.1), ("coulomb.torque", 0.05))},
    }  # fmt: skip
    return {
        "verdict": verdict | changes, "candidates": [candidate], "logs": ["rock.csv"], "noise_floor_rad": 1e-3,
        "record": board.digest, "best": candidate,
    }  # fmt: skip


def test_a_diagnosis_older_than_the_fit_is_not_shown_as_current(space, tmp_path):
    copy = shutil.copytree(space, tmp_path / "copy")
    board = Board.load("pink", copy)

    def page_of(content):
        (copy / "reports" / "pink" / "diagnose.json").write_text(json.dumps(content))
        return reported(copy)

    text = page_of({**diagnosed(board), "record": "another"})
    assert "✓ coulomb (dry friction) added; nothing is left" in text
    assert "husky-sysid check" in text
    assert "✗ coulomb" not in text
    text = page_of(
        {**diagnosed(board, effects=["coulomb", "offset"]), "record": "another"}
    )  # fits find the rest
    assert "offset (rest angle moved) added; nothing is left" in text
    text = page_of({**diagnosed(board, effects=["freeplay"]), "record": "another"})
    assert "Not asked since the record was last changed" in text
    text = page_of(diagnosed(board, effects=["freeplay"]))
    assert "✗ freeplay (" in text
    assert "--effect freeplay" in text
    text = page_of(diagnosed(board, status="none-missing", effects=[]))
    assert "Nothing that matters" in text
    assert "Not asked" not in text


def test_a_failed_check_stands_in_the_answers(space, tmp_path, monkeypatch):
    """A law that fits its log is no match where the scene that was made of it decays otherwise."""
    shutil.copytree(space, tmp_path / "a copy")
    monkeypatch.chdir(tmp_path)
    board = Board.load("pink", tmp_path / "a copy")
    failed = {"passed": False, "nrmse": 0.447, "tolerance": 0.02, "scene": "bench", "logs": []}
    Workspace(Path("a copy")).save_board(board.checked(failed))
    text = reported(Path("a copy"))
    assert "✗ The law fits the logs" in text
    assert "the MuJoCo scene does not: the check failed with an NRMSE of 44.70 %" in text
    command = re.search(r"See why the scene fails: husky-sysid (check .*?)</dd>", text)[1]
    assert "✓ Yes" not in text
    assert called(*shlex.split(command)) == 0


def test_print_is_complete(tab, tmp_path):
    tab.pdf(tmp_path / "page.pdf")
    reader = shutil.which("pdftotext")
    if reader is None:
        pytest.skip("pdftotext is not installed")
    text = subprocess.run([reader, tmp_path / "page.pdf", "-"], capture_output=True, text=True).stdout
    for section in tab.run("[...document.querySelectorAll('h2')].map(h => h.textContent)"):
        assert section in text
    for number in (1, 2, 3):  # all releases, also those that are not chosen
        assert f"release {number}: error" in text
    assert "sha256" in text


@pytest.mark.parametrize("board", ["pink", "black"])
def test_the_finished_reports_are_whole(board):
    folder = REPORTS / board
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert "These logs are synthetic" in text
    assert "<h2>Provenance</h2>" in text
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]+"', "", text)
    assert "/tmp" not in text
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1.5e6


def test_a_pendulum_without_a_spring_has_a_page(tmp_path):
    def law(angle, rate):
        return -36.0 * np.sin(angle) - 0.1 * rate

    log = rocked(tmp_path / "swing.csv", law=law, omega=6.0, amplitudes=(0.9,), sampling=100, free=12.0)
    called("new", "arm", "--inertia", "0.01", "--workspace", tmp_path)
    fixed = ("--effect", "gravity", "--fix", "stiffness=0")
    called("fit", log, "-b", "arm", "--workspace", tmp_path, *fixed)
    assert re.search(
        r"<dd>95 % intervals: d to ±[\d.]+ %, gravity to ±", reported(tmp_path, log, board="arm")
    )
