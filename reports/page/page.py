"""One self-contained HTML page: no external source, light and dark, printable."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from reports.playground import Playground


@dataclass(slots=True)
class Page:
    """Collects sections in reading order and renders them as one file."""

    title: str
    subtitle: str
    lead: str = ""
    """HTML between the heading and the first section, for a hurried reader."""
    _sections: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])

    def section(self, title: str, *parts: str) -> None:
        """Add a section; parts are HTML made by the functions below."""
        self._sections.append((title, "\n".join(part for part in parts if part)))

    def render(self) -> str:
        """Return the whole page; style and script are inlined."""
        links = "".join(
            f'<a href="#s{i}">{escape(title)}</a>' for i, (title, _) in enumerate(self._sections, start=1)
        )
        body = "\n".join(
            f'<section id="s{i}"><h2>{escape(title)}</h2>\n{content}\n</section>'
            for i, (title, content) in enumerate(self._sections, start=1)
        )
        return (
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            # An empty icon keeps browsers from asking a server for one.
            '<link rel="icon" href="data:,">\n'
            f"<title>{escape(self.title)}</title>\n<style>\n{_asset('page.css')}</style>\n</head>\n<body>\n"
            f'<h1>{escape(self.title)}</h1>\n<p class="sub">{escape(self.subtitle)}</p>\n{self.lead}\n<nav>{links}</nav>\n'
            f"{body}\n<script>\n{_asset('page.js')}</script>\n</body>\n</html>\n"
        )


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph of plain text; its kind is 'note' for a frame, 'law' for an equation set apart."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def verdict(text: str, *, good: bool) -> str:
    """Return the one sentence a reader is looking for."""
    return f'<p class="verdict {"good" if good else "bad"}">{"✓" if good else "✗"} {escape(text)}</p>'


def warning_list(warnings: Sequence[str], without: str = "None.") -> str:
    """Return warnings as a list; the other text without any."""
    if not warnings:
        return paragraph(without)
    return '<ul class="warnings">' + "".join(f"<li>{escape(text)}</li>" for text in warnings) + "</ul>"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of plain texts; long hexadecimal ones may be broken anywhere."""
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _cell(text: str) -> str:
    digest = len(text) == 64 and all(letter in "0123456789abcdef" for letter in text)
    return f'<td class="digest">{text}</td>' if digest else f"<td>{escape(text)}</td>"


def figure(svg: str, caption: str, title: str = "") -> str:
    """Return an inline figure with its title and caption."""
    head = f"<h3>{escape(title)}</h3>" if title else ""
    return f"<figure>{head}{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def answers(rows: Sequence[tuple[str, str, str]]) -> str:
    """Return questions with their answers and a mark each: 'good', 'bad' or ''."""
    signs = {"good": "✓ ", "bad": "✗ "}
    body = "".join(
        f'<div class="{mark}"><dt>{escape(question)}</dt><dd>{signs.get(mark, "")}{escape(answer)}</dd></div>'
        for question, answer, mark in rows
    )
    return f'<dl class="answers">{body}</dl>'


def panels(parts: Sequence[str]) -> str:
    """Return figures side by side if there is room, else one below another."""
    return f'<div class="panels">{"".join(parts)}</div>'


def sliders(play: "Playground", remark: str) -> str:
    """Return sliders over a joint: its functions in JavaScript, and their data."""
    content = json.dumps(play.to_json(), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return (
        '<div id="play"><div class="presets"></div>'
        '<div class="table"><div><p class="big"><span class="error"></span> × noise'
        '<select class="release" aria-label="release"></select></p>'
        '<svg class="curve" role="img" aria-label="measured and simulated decay"></svg></div>'
        f'<div><div class="sliders"></div><p class="sub">{escape(remark)}</p></div></div>'
        "<noscript>The sliders need JavaScript; everything below does not.</noscript></div>"
        f'<script type="application/json" id="play-data">{content}</script>'
        f'<script>\n"use strict";\n{play.code}{_asset("play.js")}</script>'
    )


def choices(parts: Sequence[tuple[str, str]]) -> str:
    """Return several pieces of HTML of which the page shows one at a time, all of them in print."""
    if len(parts) == 1:
        return parts[0][1]
    buttons = "".join(
        f'<button type="button" data-shows="{escape(name)}">{escape(name)}</button>' for name, _ in parts
    )
    bodies = "".join(f'<div data-choice="{escape(name)}">{content}</div>' for name, content in parts)
    return f'<div><div class="choices">{buttons}</div>{bodies}</div>'


def _asset(name: str) -> str:
    return (files("reports") / name).read_text(encoding="utf-8")
