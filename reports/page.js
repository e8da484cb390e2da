"use strict";
// Series can be switched off, one of several figures chosen, and values read under the pointer.
for (const figure of document.querySelectorAll("figure")) {
  const svg = figure.querySelector("svg.figure");
  const source = svg && svg.querySelector("script.hover");
  if (!source) continue;
  const panels = JSON.parse(source.textContent);
  const hidden = new Set();
  const groups = (name) =>
    [...svg.querySelectorAll("g")].filter((g) => g.id.endsWith("-series:" + name) || g.id.includes("-series:" + name + "@"));

  const names = new Map();
  for (const panel of panels)
    for (const series of panel.series) names.set(series.name.split("@")[0], series.colour);
  if (names.size > 1) {
    const box = document.createElement("div");
    box.className = "toggles";
    for (const [name, colour] of names) {
      const label = document.createElement("label");
      const input = document.createElement("input");
      input.type = "checkbox";
      input.checked = true;
      input.addEventListener("change", () => {
        input.checked ? hidden.delete(name) : hidden.add(name);
        for (const group of groups(name)) group.style.display = input.checked ? "" : "none";
      });
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = colour.toUpperCase() === "#0072B2" ? "var(--sim)" : colour;
      label.append(input, swatch, name);
      box.append(label);
    }
    svg.before(box);
  }

  const tip = document.createElement("div");
  tip.className = "tip";
  figure.append(tip);
  svg.addEventListener("pointerleave", () => (tip.style.display = "none"));
  svg.addEventListener("pointermove", (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const panel = panels.find(
      ({ box: [x, y, w, h] }) => point.x >= x && point.x <= x + w && point.y >= y && point.y <= y + h
    );
    if (!panel) return void (tip.style.display = "none");
    const lines = [];
    for (const series of panel.series) {
      const name = series.name.split("@")[0];
      if (hidden.has(name) || series.px.length === 0) continue;
      let best = 0;
      for (let i = 1; i < series.px.length; i++)
        if (Math.abs(series.px[i] - point.x) < Math.abs(series.px[best] - point.x)) best = i;
      if (lines.length === 0) lines.push(`${panel.x || "x"}: ${series.x[best]}`);
      lines.push(`${name}: ${series.y[best]}`);
    }
    const frame = figure.getBoundingClientRect();
    tip.textContent = lines.join("\n");
    tip.style.display = lines.length ? "block" : "none";
    tip.style.left = Math.min(event.clientX - frame.left + 14, frame.width - 170) + "px";
    tip.style.top = event.clientY - frame.top + 10 + "px";
  });
}

for (const set of document.querySelectorAll(".choices")) {
  const shown = (name) => {
    for (const button of set.querySelectorAll("button"))
      button.setAttribute("aria-pressed", String(button.dataset.shows === name));
    for (const part of set.parentElement.querySelectorAll("[data-choice]"))
      part.style.display = part.dataset.choice === name ? "" : "none";
  };
  for (const button of set.querySelectorAll("button")) button.addEventListener("click", () => shown(button.dataset.shows));
  const first = set.querySelector("button");
  if (first) shown(first.dataset.shows);
}
