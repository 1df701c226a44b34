"use strict";
// Draws one run at a time with Plotly, and plays its recorded frames. Data: #data, filled by page.py.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const element = (id) => document.getElementById(id);
  // Okabe & Ito's colours, which colour-blind readers tell apart; each status has a shade of its own, too.
  const STATUS = {
    searching: ["#56b4e9", "searching"], converged: ["#0072b2", "converged"],
    ambiguous: ["#f0e442", "ambiguous"], lost: ["#d55e00", "lost"], stale: ["#222222", "stale"],
  };
  const STAGES = ["#0072b2", "#e69f00", "#56b4e9", "#f0e442", "#009e73", "#d55e00"];
  const FRAME_MS = 350;
  // Lengths of the lines that show a heading, as shares of the map's larger side.
  const POINTER = 0.07, PARTICLE = 0.025;
  let run = data.runs[0], frame = 0, timer = null, frames = null;

  // ---- packed data ----
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const shorts = (text) => new Uint16Array(bytes(text).buffer);

  // ---- looks ----
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const dark = () => matchMedia("(prefers-color-scheme: dark)").matches;
  const narrow = () => innerWidth < 600;
  const axis = (title, more) => ({
    title: { text: title, standoff: 6 }, gridcolor: css("--line"), zeroline: false, linecolor: css("--soft"), automargin: true, ...more,
  });
  const layout = (height, more) => ({
    height, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", margin: { l: 56, r: 12, t: 8, b: 40 },
    font: { color: css("--ink"), size: 12, family: "system-ui, sans-serif" }, hovermode: "closest",
    legend: { orientation: "h", x: 0, xanchor: "left", y: 1.02, yanchor: "bottom" }, ...more,
  });
  const config = { responsive: true, displaylogo: false, displayModeBar: false, scrollZoom: false };
  const draw = (id, traces, plan) => Plotly.react(element(id), traces, plan, config);
  const equal = () => ({
    xaxis: axis("x [m]", { constrain: "domain" }), yaxis: axis("y [m]", { scaleanchor: "x", scaleratio: 1, constrain: "domain" }),
  });
  const bar = (title, more) => ({
    title: { text: title, side: "top" }, orientation: "h", x: 0.5, y: -56 / (mapHeight() - 136), yanchor: "top", thickness: 10, len: 0.9, outlinewidth: 0, ...more,
  });
  const metres = (value) => (value >= 1 ? `${value.toFixed(2)} m` : value >= 0.01 ? `${(100 * value).toFixed(1)} cm` : `${(1000 * value).toFixed(1)} mm`);
  const mapHeight = () => {
    const r = run.recording ? run.recording.bounds : null;
    const ratio = r ? (r[3] - r[1]) / (r[2] - r[0]) : 0.8;
    const width = element("trajectory").clientWidth || 360;
    // As much as fits below the controls, so that a player can be watched without scrolling.
    const most = narrow() ? 620 : Math.min(Math.max(innerHeight - 470, 300), 620);
    return Math.round(Math.min(Math.max(ratio * (width - 70), 220), most) + 160);
  };
  const places = (size) => ({
    x: data.places.x, y: data.places.y, type: "scatter", mode: "markers", name: "references", hoverinfo: "text",
    text: data.places.x.map((_, i) => `reference ${i}`), marker: { symbol: "cross-thin", size, line: { width: 1, color: css("--soft") } },
  });
  // Relative poses of the map's keyframes, by kind, and how far references were moved.
  const graph = () => {
    if (!data.graph) return [];
    const strokes = (name, ends, color) => ({
      x: ends.flatMap(([a, b]) => [a[0], b[0], null]), y: ends.flatMap(([a, b]) => [a[1], b[1], null]), name,
      type: "scatter", mode: "lines", hoverinfo: "skip", line: { color: css(color), width: 0.7 },
    });
    const at = (i) => [data.places.x[i], data.places.y[i]], colors = ["--soft", "--green", "--red"];
    const lines = Object.entries(data.graph.lines).map(([name, pairs], k) => strokes(name, pairs.map(([i, j]) => [at(i), at(j)]), colors[k]));
    const moved = strokes("moved", data.graph.moved.map(([i, x, y]) => [[x, y], at(i)]), "--orange");
    return [...lines, moved].filter((stroke) => stroke.x.length);
  };
  const truthLine = () => ({
    ...gaps(run.truth.x, run.truth.y), type: "scatter", mode: "lines", name: "true path", hoverinfo: "skip",
    line: { color: css("--ink"), width: 1.2, dash: "dot" },
  });
  // Lines break where the robot was carried away.
  function gaps(x, y) {
    const outX = [], outY = [];
    run.seconds.forEach((t, i) => {
      if (i && run.teleports.some((s) => s > run.seconds[i - 1] && s <= t)) { outX.push(null); outY.push(null); }
      outX.push(x[i]); outY.push(y[i]);
    });
    return { x: outX, y: outY };
  }

  // ---- pictures over time ----
  function drawTrajectory() {
    const known = run.position_error !== null, traces = [...graph(), places(7)];
    if (known) traces.push(truthLine());
    const least = 0.001, colour = known ? run.position_error.map((e) => Math.log10(Math.max(e, least))) : css("--blue");
    traces.push({
      x: run.pose.x, y: run.pose.y, type: "scatter", mode: "markers", name: "estimate", hoverinfo: "text",
      text: run.seconds.map((t, i) => `${t} s, ${run.status[i]}${known ? `, ${metres(run.position_error[i])}` : ""}`),
      marker: {
        size: 9, color: colour, line: { width: 0.8, color: css("--ink") },
        ...(known && { colorscale: "Viridis", cmin: -3, cmax: 1, showscale: true,
          colorbar: bar("position error", { tickvals: [-3, -2, -1, 0, 1], ticktext: ["≤ 1 mm", "1 cm", "10 cm", "1 m", "10 m"] }) }),
      },
    });
    draw("trajectory", traces, layout(mapHeight(), { ...equal(), margin: { l: 56, r: 12, t: 40, b: 96 } }));
  }

  const teleports = () => run.teleports.map((t) => ({
    type: "line", x0: t, x1: t, yref: "paper", y0: 0, y1: 1, line: { color: css("--soft"), width: 1, dash: "dash" },
  }));
  const span = () => {
    const last = run.seconds[run.seconds.length - 1] || 1;
    return [-0.01 * last, (1 + 1 / Math.max(run.seconds.length, 1)) * last];
  };
  const over = (id, traces, title, height, more) => {
    const { yaxis, ...rest } = more || {};
    draw(id, traces, layout(height, {
      xaxis: axis("time since the first image [s]", { range: span() }), yaxis: axis(title, yaxis), shapes: teleports(),
      margin: { l: 62, r: 12, t: 34, b: 44 }, showlegend: true, ...rest,
    }));
  };
  const line = (y, name, color, more) => ({
    x: run.seconds, y, name, type: "scatter", mode: run.seconds.length < 60 ? "lines+markers" : "lines",
    marker: { size: 4 }, line: { color, width: 1.6 }, ...more,
  });

  function drawStatus() {
    const [, end] = span(), traces = [], spells = [];
    run.status.forEach((status, i) => {
      const before = spells[spells.length - 1];
      if (!before || before.status !== status) spells.push({ status, start: run.seconds[i] });
    });
    spells.forEach((spell, i) => { spell.end = i + 1 < spells.length ? spells[i + 1].start : end; });
    for (const [status, [color, name]] of Object.entries(STATUS)) {
      const those = spells.filter((spell) => spell.status === status);
      const base = those.map((spell) => spell.start), x = those.map((spell) => spell.end - spell.start);
      traces.push({
        type: "bar", orientation: "h", name, base, x: x.length ? x : [null], y: (x.length ? x : [0]).map(() => "status"), width: 0.8,
        marker: { color, line: { width: 0 }, pattern: { shape: { searching: "/", converged: "", ambiguous: "x", lost: "\\", stale: "-" }[status], solidity: 0.2, fillmode: "overlay", fgcolor: "rgba(0,0,0,0.55)", size: 7 } },
        hovertemplate: `${name} from %{base} s<extra></extra>`,
      });
    }
    over("status", traces, "", 112, { barmode: "overlay", yaxis: { showticklabels: false, showgrid: false, fixedrange: true } });
  }

  function drawOverTime() {
    drawStatus();
    for (const id of ["position-error", "heading-error"]) element(id).hidden = run.position_error === null;
    if (run.position_error !== null) {
      const limit = (value) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: value, y1: value, line: { color: css("--soft"), width: 1, dash: "dot" } });
      const floor = (values, least) => values.map((v) => Math.max(v, least));
      const claimed = (sd, least) => sd ? [line(floor(sd, least), "claimed sd", css("--orange"), { mode: "lines", line: { color: css("--orange"), width: 1.2, dash: "dash" } })] : [];
      const decades = { type: "log", exponentformat: "none", dtick: 1 };
      const { position_m, heading_deg } = data.limits;
      over("position-error", [line(floor(run.position_error, 1e-4), "position error", css("--blue")), ...claimed(run.position_claimed, 1e-4)], "position error [m]", 190,
        { yaxis: decades, showlegend: Boolean(run.position_claimed), margin: { l: 62, r: 12, t: 8, b: 44 }, shapes: [...teleports(), limit(position_m)] });
      over("heading-error", [line(floor(run.heading_error, 1e-3), "heading error", css("--blue")), ...claimed(run.heading_claimed, 1e-3)], "heading error [°]", 240,
        { yaxis: decades, shapes: [...teleports(), limit(heading_deg)] });
    }
    const headings = [line(run.pose.heading, "estimate", css("--orange"), { mode: "markers", marker: { size: 6, color: css("--orange") } })];
    if (run.truth) headings.push(line(run.truth.heading, "truth", css("--ink"), { mode: "markers", marker: { size: 9, symbol: "circle-open", color: css("--ink") } }));
    over("heading", headings, "heading [°]", 240, { yaxis: { range: [-185, 185], dtick: 90 } });
    over("n-eff", [line(run.n_eff, "N<sub>eff</sub>", css("--blue")), line(run.particles, "particles", css("--orange"), { line: { color: css("--orange"), dash: "dot" } })],
      "particles", 240, { yaxis: { rangemode: "tozero" } });
    // The first image may be slow, as kernels are loaded: it must not flatten the others.
    const names = Object.keys(run.stages);
    const totals = run.seconds.map((_, i) => names.reduce((sum, name) => sum + (run.stages[name][i] || 0), 0));
    const ordered = [...totals].sort((a, b) => a - b), high = 1.6 * ordered[Math.floor(0.9 * (ordered.length - 1))];
    const cut = totals.map((total, i) => i).filter((i) => totals[i] > high).sort((a, b) => totals[b] - totals[a]);
    over("stages", Object.entries(run.stages).map(([name, ms], i) => ({
      x: run.seconds, y: ms, name, type: "bar", marker: { color: STAGES[i % STAGES.length] },
    })), "time of one image [ms]", 260, {
      barmode: "stack", bargap: 0.1, yaxis: { range: [0, cut.length ? high : 1.05 * ordered[ordered.length - 1]] },
      legend: { orientation: "h", x: 0, xanchor: "left", y: 1.02, yanchor: "bottom", traceorder: "normal" },
      // Texts of neighbours would lie over each other, so only the slowest is named.
      annotations: cut.map((i) => ({
        x: run.seconds[i], y: 1, yref: "paper", yanchor: "top", xanchor: "left", xshift: 6, showarrow: false, text: `↑ ${Math.round(totals[i])} ms`,
      })).slice(0, 1),
    });
  }

  // ---- the player ----
  function unpack(r) {
    const cells = r.raster.rows * r.raster.columns, count = r.particle_count, [x0, y0, x1, y1] = r.bounds;
    const onMap = bytes(r.on_map), votes = bytes(r.votes), headings = bytes(r.heading_votes), packed = shorts(r.particles), prior = shorts(r.prior);
    const steps = (n, first) => Array.from({ length: n }, (_, i) => first + i * r.raster.step);
    const cloud = (from, start) => {
      const x = [], y = [], tailX = [], tailY = [], length = PARTICLE * Math.max(x1 - x0, y1 - y0);
      for (let i = 0; i < count; i++) {
        const at = start + 3 * i;
        const atX = x0 + (x1 - x0) * from[at] / 65535, atY = y0 + (y1 - y0) * from[at + 1] / 65535, turn = 2 * Math.PI * from[at + 2] / 65535;
        x.push(atX); y.push(atY);
        tailX.push(atX, atX + length * Math.cos(turn), null); tailY.push(atY, atY + length * Math.sin(turn), null);
      }
      return { x, y, tailX, tailY };
    };
    return {
      x: steps(r.raster.columns, r.raster.x), y: steps(r.raster.rows, r.raster.y),
      side: Math.max(x1 - x0, y1 - y0), prior: count > 0 ? 1 : 0,
      votes: (i) => Array.from({ length: r.raster.rows }, (_, row) => Array.from({ length: r.raster.columns }, (_, column) => {
        const cell = row * r.raster.columns + column;
        return onMap[cell] ? (i < 0 ? 0 : votes[i * cells + cell] / 255 * r.peaks[i]) : null;
      })),
      headings: (i) => Array.from({ length: r.headings }, (_, k) => (i < 0 ? 0 : headings[i * r.headings + k] / 255 * r.peaks[i])),
      particles: (i) => (i < 0 ? cloud(prior, 0) : cloud(packed, 3 * count * i)),
    };
  }

  function scale() {
    const tint = dark() ? "86,180,233" : "0,114,178";
    return [[0, `rgba(${tint},0)`], [0.5, `rgba(${tint},0.25)`], [1, `rgba(${tint},1)`]];
  }

  // Index of the recorded frame that the slider shows; -1 is the belief before the first image.
  const shown = () => frame - frames.prior;

  function mapTraces() {
    const r = run.recording, i = shown(), cloud = frames.particles(i);
    const [chance, most] = r.vote_range;
    const traces = [{
      type: "heatmap", name: "votes", x: frames.x, y: frames.y, z: frames.votes(i), zmin: chance, zmax: most, colorscale: scale(),
      hovertemplate: "x %{x:.2f} m, y %{y:.2f} m<br>votes %{z:.3f}<extra></extra>", colorbar: bar("votes of the best heading"),
    }, places(6)];
    if (run.truth) traces.push(truthLine());
    const group = (name) => ({ type: "scatter", name, hoverinfo: "skip" });
    if (run.recording.particle_count) {
      traces.push({ ...group("headings of particles"), x: cloud.tailX, y: cloud.tailY, mode: "lines", showlegend: false, line: { color: css("--orange"), width: 1 } });
      traces.push({ ...group("particles"), x: cloud.x, y: cloud.y, mode: "markers", marker: { size: 4.5, color: css("--orange") } });
    }
    const best = i < 0 ? -1 : r.best_place[i];
    traces.push({
      ...group("best reference"), mode: "markers", x: [best < 0 ? null : data.places.x[best]], y: [best < 0 ? null : data.places.y[best]],
      marker: { symbol: "square-open", size: 15, color: css("--ink"), line: { width: 2, color: css("--ink") } },
    });
    // A dot or a ring with a line ahead; the line of the estimate on a ground of its own, as it lies among the particles.
    const pointer = (pose, name, color, marker) => {
      const turn = i < 0 ? 0 : pose.heading[i] * Math.PI / 180, length = POINTER * frames.side;
      const x = i < 0 ? [null] : [pose.x[i], pose.x[i] + length * Math.cos(turn)];
      const y = i < 0 ? [null] : [pose.y[i], pose.y[i] + length * Math.sin(turn)];
      const ahead = { ...group(`heading of ${name}`), x, y, mode: "lines", showlegend: false };
      traces.push({ ...ahead, line: { color: css("--page"), width: 6 } }, { ...ahead, line: { color, width: 3 } });
      traces.push({ ...group(name), x: [x[0]], y: [y[0]], mode: "markers", marker });
    };
    if (r.truth) pointer(r.truth, "truth", css("--ink"), { symbol: "circle-open", size: 17, color: css("--ink"), line: { width: 2.2, color: css("--ink") } });
    pointer(r.pose, "estimate", css("--red"), { size: 11, color: css("--red"), line: { width: 1.5, color: css("--page") } });
    return traces;
  }

  const fill = (id, image, share) => {
    const box = element(id);
    box.style.backgroundImage = image ? `url(data:image/jpeg;base64,${image})` : "none";
    box.style.backgroundPositionX = `${Math.round(share * box.clientWidth)}px`;
    box.classList.toggle("empty", !image);
  };

  // How well the image fits each heading, at its best place.
  function drawHeadings() {
    const r = run.recording, i = shown(), count = r.headings, half = Math.floor(count / 2);
    const turned = Array.from({ length: count + 1 }, (_, k) => (k - half) * 360 / count);
    const votes = frames.headings(i), at = (name, pose, color, dash) => ({
      type: "scatter", mode: "lines", name, hoverinfo: "name", x: i < 0 ? [null] : [pose.heading[i], pose.heading[i]], y: i < 0 ? [null] : [0, top],
      line: { color, width: 2, dash },
    });
    const top = 1.05 * Math.max(...r.peaks, 1e-6);
    const traces = [{
      type: "scatter", mode: "lines", name: "votes", x: turned, y: turned.map((_, k) => votes[(k - half + count) % count]), fill: "tozeroy",
      line: { color: css("--blue"), width: 1.2 }, hovertemplate: "%{x:.0f}°: %{y:.3f}<extra></extra>",
    }];
    if (r.truth) traces.push(at("truth", r.truth, css("--ink"), "dot"));
    traces.push(at("estimate", r.pose, css("--red"), "solid"));
    draw("headings", traces, layout(150, {
      xaxis: axis("heading in the map, left positive [°]", { range: [180, -180], tickvals: [180, 90, 0, -90, -180] }), yaxis: axis("votes", { range: [0, top], nticks: 4 }),
      margin: { l: 62, r: 26, t: 26, b: 40 },
    }));
  }

  // A line at the time of the frame that is shown, in the plots beside the map.
  function drawCursor() {
    const i = shown(), now = run.recording.seconds[Math.max(i, 0)];
    for (const id of ["status", "position-error"]) {
      const plot = element(id);
      if (plot.hidden) continue;
      const others = plot.layout.shapes.filter((shape) => shape.name !== "cursor");
      const cursor = { name: "cursor", type: "line", x0: now, x1: now, yref: "paper", y0: 0, y1: 1, line: { color: css("--ink"), width: 2 } };
      Plotly.relayout(plot, { shapes: i < 0 ? others : [...others, cursor] });
    }
  }

  function drawFrame() {
    const r = run.recording, i = shown(), [x0, y0, x1, y1] = r.bounds;
    const plan = layout(mapHeight() + (narrow() ? 30 : 10), { ...equal(), margin: { l: 56, r: 12, t: narrow() ? 72 : 50, b: 96 }, uirevision: run.title });
    plan.xaxis.range = [x0, x1]; plan.yaxis.range = [y0, y1];
    draw("map", mapTraces(), plan);
    drawHeadings();
    drawCursor();
    // Heading in the middle; the reference turned as the robot is, so that both show the same directions.
    fill("panorama", i < 0 ? "" : r.panoramas[i], 0.5);
    const best = i < 0 ? -1 : r.best_place[i];
    fill("reference", best < 0 ? "" : r.references[best], i < 0 ? 0.5 : 0.5 + r.pose.heading[i] / 360);
    element("reference-name").textContent = best < 0 ? "" : `: ${data.places.files[best] || best}`;
    const total = r.seconds.length;
    let text = "before the first image";
    if (i >= 0) {
      text = `frame ${i + 1} of ${total}, ${r.seconds[i].toFixed(2)} s: ${r.status[i]}`;
      if (r.position_error) text += `, error ${metres(r.position_error[i])}, ${r.heading_error[i].toFixed(2)}°`;
      if (run.teleports.includes(r.seconds[i])) text += "; carried away just before";
      if (r.message[i]) text += `; ${r.message[i]}`;
    }
    element("caption").textContent = text;
    element("slider").value = frame;
    element("slider").setAttribute("aria-valuetext", text);
  }

  const last = () => run.recording.seconds.length - 1 + frames.prior;
  function show(next) { frame = Math.min(Math.max(next, 0), last()); drawFrame(); }
  function stop() { clearInterval(timer); timer = null; element("play").textContent = "▶ Play"; }
  function toggle() {
    if (timer !== null) { stop(); return; }
    if (frame >= last()) show(0);
    element("play").textContent = "❚❚ Pause";
    timer = setInterval(() => { show(frame + 1); if (frame >= last()) stop(); }, FRAME_MS);
  }

  function choose(index) {
    stop();
    run = data.runs[index];
    const recorded = run.recording !== null && run.recording.seconds.length > 0;
    element("player").classList.toggle("still", !recorded);
    frames = recorded ? unpack(run.recording) : null;
    if (recorded) {
      element("slider").max = last();
      frame = 0;
    }
    drawAll();
  }
  function drawAll() {
    drawTrajectory();
    drawOverTime();
    if (frames) drawFrame();
  }

  element("play").addEventListener("click", toggle);
  element("slider").addEventListener("input", (event) => { stop(); show(Number(event.target.value)); });
  element("run").addEventListener("change", (event) => choose(Number(event.target.value)));
  addEventListener("keydown", (event) => {
    if (!frames || event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
    const step = { ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[event.key];
    if (step !== undefined) { stop(); show(frame + step); } else if (event.key === " ") toggle(); else return;
    event.preventDefault();
  });
  // A click on the time goes to the frame of that time.
  for (const id of ["status", "position-error"]) {
    element(id).addEventListener("click", (event) => {
      const plot = element(id), axes = plot._fullLayout.xaxis, at = axes.p2d(event.clientX - plot.getBoundingClientRect().left - axes._offset);
      if (!frames || !Number.isFinite(at)) return;
      const seconds = run.recording.seconds;
      let nearest = 0;
      seconds.forEach((second, i) => { if (second <= at) nearest = i; });
      stop();
      show(nearest + frames.prior);
    });
  }
  let waiting = null;
  const again = () => { clearTimeout(waiting); waiting = setTimeout(drawAll, 150); };
  let width = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; again(); } });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  choose(0);
})();
