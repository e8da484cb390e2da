"use strict";
// Another release has ended: show it. The page is made anew; nothing is asked of anyone but this machine.
setInterval(async () => {
  try {
    const state = await (await fetch("/state")).json();
    if (state.version !== Number(document.body.querySelector("[data-version]").dataset.version)) location.reload();
  } catch { document.title = "ended"; }
}, 400);
