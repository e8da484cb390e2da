"use strict";
// One of several figures is chosen; print shows all.
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
