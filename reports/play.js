// Sliders: the joint is simulated here, with the functions `held`, `initial`, `step`, `cut`, `output` and `reading`
// that the report printed from the tool's own law. Roll and rate at each release are fitted, as `compare` does.
(() => {
  const box = document.getElementById("play");
  if (!box) return;
  const play = JSON.parse(document.getElementById("play-data").textContent);
  const numbers = ({ from, to, left }) => {
    const bytes = Uint8Array.from(atob(left), (letter) => letter.charCodeAt(0));
    const rest = new Float32Array(bytes.buffer);
    return Float64Array.from(rest, (value, i) => from + ((to - from) * i) / Math.max(rest.length - 1, 1) + value);
  };
  const h = play.step;
  const releases = play.releases.map((release) => {
    const time = numbers(release.time);
    const grid = Math.floor(time[time.length - 1] / h) + 2;
    return { ...release, time, signal: numbers(release.signal), grid, own: null };
  });
  const unscaled = play.scale;
  let preset = play.begin;
  let p = Float64Array.from(play.presets[preset].vector);
  let shown = 0;

  // The numbers with what is known to differ in one release: another pose, another load.
  function inPose(release) {
    if (!release.known.length) return p;
    const other = p.slice();
    for (const [index, value] of release.known) other[index] = value;
    return other;
  }

  // What the sensor would read of one release that starts so.
  function simulate(release, own) {
    const p = inPose(release), zeros = play.presets[preset].zeros;
    const motion = own.slice(0, 2 + play.internal.length);
    let y = initial(p, motion, [release.hold]);
    const angles = new Float64Array(release.grid), rates = new Float64Array(release.grid);
    for (let i = 0; i < release.grid; i++) {
      [angles[i], rates[i]] = output(y, p);
      const next = step(y, p, [h]);
      y = play.turns && next[y.length] ? cut(y, p, [h]) : next.subarray(0, y.length);
    }
    const seen = new Float64Array(release.time.length);
    for (let k = 0; k < seen.length; k++) {
      const at = release.time[k] / h, i = Math.min(Math.floor(at), release.grid - 2), s = at - i;
      const a = angles[i], b = angles[i + 1], u = h * rates[i], v = h * rates[i + 1];
      let angle = (1 + 2 * s) * (1 - s) ** 2 * a + s * (1 - s) ** 2 * u + s * s * (3 - 2 * s) * b - s * s * (1 - s) * v;
      let rate = ((6 * s * (1 - s) * (b - a) + (1 - s) * (1 - 3 * s) * u + s * (3 * s - 2) * v) / h) / play.ratio;
      if (play.reads) [angle, rate] = reading([angle], [rate], [release.begin + release.time[k] * play.ratio], p);
      seen[k] = (play.isRate ? rate : angle) + (zeros ? own[own.length - 1] : 0);
    }
    return seen;
  }

  // Half the sum of squares in units of the noise, as the fit has it: a deck let go from rest starts no faster than from rest.
  function misfit(release, index, own) {
    const seen = simulate(release, own), deviation = play.noise / Math.sqrt(release.width);
    const residual = seen.map((value, k) => (value - release.signal[k]) / deviation);
    const spread = play.presets[preset].spreads[index];
    const fast = spread === null ? 0 : Math.max(0, (release.inward * own[1]) / spread);
    let cost = fast * fast;
    for (const value of residual) cost += value * value;
    return { seen, residual, fast, cost: isFinite(cost) ? cost : Infinity };
  }

  function start(release) {
    const rest = Array.from(held(inPose(release), release.guess, [release.hold]));
    return [...release.guess, ...play.internal.map((i) => rest[i]), ...(play.presets[preset].zeros ? [0] : [])];
  }

  // Levenberg and Marquardt's descent, from where the release last started.
  function fitted(release, index) {
    let own = release.own || start(release), now = misfit(release, index, own), damping = 1e-6;
    if (!isFinite(now.cost)) { own = start(release); now = misfit(release, index, own); }
    for (let round = 0; round < 12 && isFinite(now.cost); round++) {
      const { zeros, spreads } = play.presets[preset], spread = spreads[index];
      const columns = own.map((value, j) => {
        const aside = own.slice(), change = 1e-5 * (zeros && j === own.length - 1 ? play.sizes[play.sizes.length - 1] : play.sizes[j]);
        aside[j] += change;
        const moved = simulate(release, aside), scale = (change * play.noise) / Math.sqrt(release.width);
        const slope = moved.map((m, k) => (m - now.seen[k]) / scale);
        return { slope, fast: j === 1 && now.fast > 0 ? release.inward / spread : 0 };
      });
      const size = columns.length, normal = columns.map(() => new Float64Array(size + 1));
      columns.forEach((a, i) => {
        columns.forEach((b, j) => { normal[i][j] = dot(a.slope, b.slope) + a.fast * b.fast; });
        normal[i][size] = -dot(a.slope, now.residual) - a.fast * now.fast;
      });
      let better = false, gain = 0;
      for (let tries = 0; tries < 6 && !better; tries++) {
        const move = solved(normal, damping), next = own.map((value, j) => value + move[j]);
        const then = misfit(release, index, next);
        if (then.cost <= now.cost) { gain = now.cost - then.cost; own = next; now = then; better = true; damping /= 10; }
        else damping = Math.max(damping * 30, 1e-3);
      }
      if (!better || gain < 1e-4 * now.cost) break;
    }
    release.own = isFinite(now.cost) ? own : null;
    release.seen = now.seen;
    release.squares = now.cost - now.fast ** 2 + release.scatter / play.noise ** 2;
    return release;
  }

  const dot = (a, b) => { let sum = 0; for (let k = 0; k < a.length; k++) sum += a[k] * b[k]; return sum; };

  function solved(normal, damping) {
    const rows = normal.map((row, i) => { const copy = row.slice(); copy[i] = row[i] * (1 + damping) + 1e-12; return copy; });
    const size = rows.length;
    for (let i = 0; i < size; i++)
      for (let j = i + 1; j < size; j++) {
        const factor = rows[j][i] / rows[i][i];
        for (let k = i; k <= size; k++) rows[j][k] -= factor * rows[i][k];
      }
    const result = new Array(size).fill(0);
    for (let i = size - 1; i >= 0; i--) {
      let left = rows[i][size];
      for (let k = i + 1; k < size; k++) left -= rows[i][k] * result[k];
      result[i] = left / rows[i][i];
    }
    return result;
  }

  // The page: buttons, sliders, one release drawn, the error of all.
  const make = (tag, attributes, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.append(...children);
    return element;
  };
  const find = (name) => box.querySelector("." + name);
  const inputs = play.sliders.map((slider) => {
    const input = make("input", { type: "range", min: slider.low, max: slider.high, step: "any", "aria-label": slider.label });
    const value = make("output", {});
    input.addEventListener("input", () => {
      p[slider.index] = Number(input.value);
      for (const button of find("presets").children) button.setAttribute("aria-pressed", "false");
      update();
    });
    find("sliders").append(make("label", {}, make("span", {}, slider.label), value, input));
    return { input, value, slider };
  });
  play.presets.forEach(({ label }, index) => {
    const button = make("button", { type: "button" }, label);
    button.addEventListener("click", () => choose(index));
    find("presets").append(button);
  });
  const select = find("release");
  releases.forEach(({ label }, index) => select.append(make("option", { value: index }, label)));
  select.hidden = releases.length < 2;
  select.addEventListener("change", () => { shown = Number(select.value); draw(); });

  function choose(index) {
    preset = index;
    p = Float64Array.from(play.presets[index].vector);
    for (const release of releases) release.own = null;
    [...find("presets").children].forEach((button, i) => button.setAttribute("aria-pressed", String(i === index)));
    for (const { input, slider } of inputs) input.value = p[slider.index];
    update();
  }

  let waiting = 0, later = 0, cost = 0;
  function update() {
    for (const { value, slider } of inputs) {
      const number = p[slider.index] * (slider.shown < 0 ? 1 : p[slider.shown]) * slider.scale;
      value.textContent = `${Number(number.toPrecision(4))} ${slider.unit}`;
    }
    cancelAnimationFrame(waiting);
    waiting = requestAnimationFrame(() => {
      const quick = cost < 50; // else the release that is drawn first, the others when the finger rests
      clearTimeout(later);
      if (quick) all();
      else { fitted(releases[shown], shown); draw(); later = setTimeout(all, 150); }
    });
  }

  function all() {
    const begin = performance.now();
    releases.forEach(fitted);
    cost = performance.now() - begin;
    const squares = releases.reduce((sum, release) => sum + release.squares, 0);
    const error = Math.sqrt(squares / releases.reduce((sum, release) => sum + release.samples, 0));
    box.dataset.error = error;
    find("error").textContent = !isFinite(error) ? "∞" : error < 100 ? error.toPrecision(3) : error.toFixed(0);
    draw();
  }

  function draw() {
    const release = releases[shown], svg = find("curve"), width = svg.clientWidth, height = svg.clientHeight;
    if (!release.seen) return;
    const left = 44, right = width - 8, top = 24, bottom = height - 34; // the legend stands above
    const last = release.time[release.time.length - 1];
    let low = Infinity, high = -Infinity;
    for (const value of release.signal) { low = Math.min(low, value); high = Math.max(high, value); }
    const pad = 0.08 * (high - low);
    const x = (t) => left + ((right - left) * t) / last;
    const y = (v) => bottom - ((bottom - top) * (Math.min(Math.max(v, low - 3 * pad), high + 3 * pad) - low + pad)) / (high - low + 2 * pad);
    const path = (values) => {
      let text = "";
      for (let k = 0; k < values.length; k++) text += `${k ? "L" : "M"}${x(release.time[k]).toFixed(1)} ${y(values[k]).toFixed(1)}`;
      return text;
    };
    const ticks = (from, to, count) => {
      const raw = (to - from) / count, power = 10 ** Math.floor(Math.log10(raw));
      const width = power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
      const marks = [];
      for (let i = Math.ceil(from / width); i * width <= to; i++) marks.push(Number((i * width).toPrecision(6)));
      return marks;
    };
    let text = "";
    for (const mark of ticks(0, last, width / 90))
      text += `<line class="grid" x1="${x(mark)}" x2="${x(mark)}" y1="${top}" y2="${bottom}"/><text x="${x(mark)}" y="${bottom + 15}" text-anchor="middle">${mark}</text>`;
    for (const mark of ticks(unscaled * (low - pad), unscaled * (high + pad), 5))
      text += `<line class="grid" x1="${left}" x2="${right}" y1="${y(mark / unscaled)}" y2="${y(mark / unscaled)}"/><text x="${left - 6}" y="${y(mark / unscaled) + 4}" text-anchor="end">${mark}</text>`;
    text += `<text x="${(left + right) / 2}" y="${height - 4}" text-anchor="middle">time since release [s]</text>`;
    text += `<text x="12" y="${(top + bottom) / 2}" text-anchor="middle" transform="rotate(-90 12 ${(top + bottom) / 2})">${play.axis}</text>`;
    [["real", "measured"], ["sim", "simulated"]].forEach(([kind, name], row) => {
      const from = right - 192 + 98 * row;
      text += `<path class="${kind}" d="M${from} ${top - 12}h20"/><text x="${from + 26}" y="${top - 8}">${name}</text>`;
    });
    text += `<path class="real" d="${path(release.signal)}"/><path class="sim" d="${path(release.seen)}"/>`;
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.innerHTML = text;
  }

  choose(preset);
  all();
  addEventListener("resize", draw);
})();
