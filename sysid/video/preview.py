"""The first frame of a film with the points to be followed, in which the region of the board can be drawn."""

import base64
import html
import json
from pathlib import Path

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.files import atomic_path
from sysid.video.film.reel import Reel
from sysid.video.overlay import SEEN_COLOUR
from sysid.video.select import find_targets

REGION_COLOUR = tuple(bytes.fromhex("b4771f"))
"""Blue, in OpenCV's order: where something moves."""
PAGE = """<!doctype html><meta charset="utf-8"><title>{name}</title>
<style>body{{font:16px sans-serif;margin:1em}} canvas{{max-width:100%;cursor:crosshair}} code{{background:#eee;padding:.3em}}</style>
<p>{what}. Blue: motion; orange: the points to be followed. Wrong? Draw the region with the mouse.</p>
<p><code id="command">{command}</code></p><canvas id="picture" width="{width}" height="{height}"></canvas>
<script>
const canvas = document.getElementById("picture"), pen = canvas.getContext("2d"), image = new Image();
let start = null;
const place = event => {{
  const box = canvas.getBoundingClientRect(), scale = canvas.width / box.width;
  const inside = (at, end) => Math.min(Math.max(Math.round(at * scale), 0), end);
  return [inside(event.clientX - box.left, canvas.width), inside(event.clientY - box.top, canvas.height)];
}};
const draw = event => {{
  if (!start) return;
  const [x, y] = place(event), corner = [Math.min(x, start[0]), Math.min(y, start[1])];
  const size = [Math.abs(x - start[0]), Math.abs(y - start[1])];
  pen.drawImage(image, 0, 0);
  document.getElementById("command").textContent = {command_json};
  if (!size.every(Boolean)) return;
  pen.strokeStyle = "#d62728"; pen.lineWidth = canvas.width / 400; pen.strokeRect(...corner, ...size);
  document.getElementById("command").textContent = {command_json} + " --roi " + [...corner, ...size].join(" ");
}};
image.onload = () => pen.drawImage(image, 0, 0);
image.src = "data:image/png;base64,{data}";
canvas.onpointerdown = event => {{ start = place(event); canvas.setPointerCapture(event.pointerId); }};
canvas.onpointermove = draw;
canvas.onpointerup = event => {{ draw(event); start = null; }};
</script>
"""


def write_preview(reel: Reel, command: str, path: Path) -> str:
    """Write a page (.html) and a picture (.png beside it) of the points to be followed; return their description, or the reason for their absence.

    The page adds the region that is drawn in it to the user's command.
    """
    picture = next(reel.clip.frames()).colour
    width = max(1, reel.clip.width // 500)
    try:
        box = reel.look.box
        cv2.rectangle(picture, box[:2], box[2:], REGION_COLOUR, width, cv2.LINE_AA)
        targets = next(find_targets(reel))
        what = "follows " + " or ".join(target.why for target in targets)
        for target in targets:
            points = target.follower.update(reel.kept[0])
            for x, y in [] if points is None else points[np.isfinite(points).all(axis=1)]:
                cv2.circle(picture, (round(16 * x), round(16 * y)), 96, SEEN_COLOUR, 2, cv2.LINE_AA, shift=4)
    except SysidError as error:
        what = str(error)
    png = cv2.imencode(".png", picture)[1].tobytes()
    with atomic_path(path.with_suffix(".png")) as temporary:
        temporary.write_bytes(png)
    page = PAGE.format(
        name=html.escape(path.stem), what=html.escape(what), command=html.escape(command), width=reel.clip.width,
        height=reel.clip.height, data=base64.b64encode(png).decode(), command_json=json.dumps(command).replace("<", "\\u003c"),
    )  # fmt: skip
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return what
