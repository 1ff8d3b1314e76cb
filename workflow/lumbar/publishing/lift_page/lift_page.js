// The page of a lift: play the recording, show a pendulum's funnel, push the pendulum and show its path.
"use strict";
window.lumbarLift = (() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const element = (id) => document.getElementById(id);
  const { follow, reached, ellipse, level, torque } = window.lumbarPendulum;
  const POINTS = 241; // of an outline that is simulated
  const EDGE = 1 + 1e-6; // V/ρ that still counts as the funnel's boundary, as in the library's check
  const TIMED = ["margin", "angle", "velocity", "funnel", "level"]; // with the present instant as a line
  const hidden = new Set(); // pictures out of sight
  let pictures; // Bokeh's document
  let columns = {}; // of the body, frame by frame
  let time = 0;
  let playing = 0; // number of the animation's next frame; 0 while it is stopped
  let loop = null; // pendulum that is shown, null where it has no funnel
  let push = null; // {knot, state, limited, path}
  let outlines = []; // simulated, per knot
  let dragging = false;
  let whole = []; // cross-sections from start to end

  const named = (name) => pictures.get_model_by_name(name);
  const set = (name, data) => { named(name).data = data; };
  const digits = (value, count = 3) => Number(value.toPrecision(count)).toString().replace("-", "−");
  const clock = (seconds) => seconds.toFixed(2);
  const chosen = (name) => document.querySelector(`input[name=${name}]:checked`)?.value;

  // ---- time ----

  function frameAt(seconds) {
    const times = columns.time;
    let [low, high] = [0, times.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= seconds) low = middle; else high = middle;
    }
    return seconds - times[low] <= times[high] - seconds ? low : high;
  }

  function phaseAt(seconds) {
    const found = page.phases.filter(([, start]) => start <= seconds);
    return (found.length ? found[found.length - 1] : page.phases[0])[0];
  }

  function seek(seconds) {
    const times = columns.time;
    time = Math.min(Math.max(seconds, times[0]), times[times.length - 1]);
    const slider = element("time");
    slider.value = time;
    slider.setAttribute("aria-valuetext", `${clock(time)} s, ${phaseAt(time)}`);
    element("now").textContent = `${clock(time)} s · ${phaseAt(time)}`;
    draw();
  }

  // Draw what is in sight: a page of pictures takes too long for a movie.
  function draw() {
    const frame = frameAt(time);
    for (const name of TIMED) if (inSight(name)) named(`ink now:${name}`).location = time;
    if (inSight("side", "behind")) drawBody(frame);
    if (inSight("above", "margin")) drawBalance(frame);
    if (loop === null || !inSight("plane")) return;
    drawSection();
    if (near()) zoom();
  }

  const inSight = (...names) => names.some((name) => !hidden.has(name));

  function watch() {
    const observer = new IntersectionObserver((changes) => {
      for (const { target, isIntersecting } of changes) {
        const name = target.id.replace("picture-", "");
        if (isIntersecting) hidden.delete(name); else hidden.add(name);
      }
      draw();
    }, { rootMargin: "100px" });
    for (const figure of document.querySelectorAll("figure[id]")) observer.observe(figure);
  }

  function play() {
    if (playing) { pause(); return; }
    const times = columns.time;
    if (time >= times[times.length - 1]) seek(times[0]);
    const speed = Number(element("speed").value);
    let before = null;
    const next = (now) => {
      if (!playing) return;
      if (before !== null) seek(time + (speed * (now - before)) / 1000);
      before = now;
      if (time >= times[times.length - 1]) { pause(); return; }
      playing = window.requestAnimationFrame(next);
    };
    playing = window.requestAnimationFrame(next);
    element("play").textContent = "Pause";
  }

  function pause() {
    window.cancelAnimationFrame(playing);
    playing = 0;
    element("play").textContent = "Play";
  }

  // ---- body and balance ----

  const at = (point, axis, frame) => columns[`${point}_${axis}`][frame];

  function drawBody(frame) {
    for (const [name, axis, plane] of [["side", "y", "flexion_extension"], ["behind", "x", "lateral_bending"]]) {
      const coordinates = (to) => page.chains.map(({ points }) => points.map((point) => at(point, to, frame)));
      set(`${name}:limbs`, {
        x: coordinates(axis), z: coordinates("z"),
        dash: page.chains.map(({ side }) => (side === "left" ? [3, 4] : [])),
      });
      set(`${name}:head`, "HEAD_z" in columns ? { x: [at("HEAD", axis, frame)], z: [at("HEAD", "z", frame)] } : { x: [], z: [] });
      set(`${name}:centres`, {
        x: page.centres.map(({ point }) => at(point, axis, frame)), y: page.centres.map(({ point }) => at(point, "z", frame)),
        mark: page.centres.map(({ mark }) => mark), size: page.centres.map(({ name: it }) => (it === "box" ? 19 : 11)), colour: page.centres.map(({ colour }) => colour),
      });
      const coms = Object.keys(page.segments).filter((com) => `${com}/${plane}/up` in columns);
      set(`${name}:pendulums`, {
        x: coms.map((com) => [at("PIVOT", axis, frame), columns[`${com}/${plane}/across`][frame]]),
        z: coms.map((com) => [at("PIVOT", "z", frame), columns[`${com}/${plane}/up`][frame]]),
        colour: coms.map((com) => page.segments[com].colour), dash: coms.map((com) => page.segments[com].dash),
      });
    }
  }

  function drawBalance(frame) {
    if (!page.balance) return;
    const data = named("balance").data;
    const bases = named("bases").data;
    const size = bases.base_x.length / data.com_x_m.length;
    const part = (values) => Array.from(values.slice(frame * size, (frame + 1) * size));
    set("above:base", { x: part(bases.base_x), y: part(bases.base_y) });
    set("above:used", { x: part(bases.used_x), y: part(bases.used_y) });
    const [x, y] = [data.com_x_m[frame], data.com_y_m[frame]];
    set("above:com", { x: [x], y: [y] });
    set("above:xcom", { x: [data.xcom_x_m[frame]], y: [data.xcom_y_m[frame]] });
    const first = frameAt(time - 0.5);
    set("above:trail", { x: Array.from(data.xcom_x_m.slice(first, frame + 1)), y: Array.from(data.xcom_y_m.slice(first, frame + 1)) });
    if (Number.isFinite(x)) set("above:bounds", { x: [x - 0.4, x + 0.4], y: [y - 0.4, y + 0.4] });
    const margin = data.margin_of_stability_m[frame];
    const impulse = data.smallest_impulse_N_s[frame];
    element("balance").textContent = Number.isFinite(margin)
      ? `Margin of stability ${digits(1000 * margin)} mm, nearest edge: ${data.direction[frame]}. ` + (margin > 0
        ? `A horizontal push of ${digits(impulse)} N·s that way would take the extrapolated centre over it (m·ω0·b).`
        : "The extrapolated centre is outside the functional base of support.")
      : "The margin of stability is not known here: a marker is not seen, or no foot stands.";
  }

  // Show all of these values, with a margin.
  function fit(picture, values, room) {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const more = room * (high - low) || 1;
    if (values.length) named(picture).y_range.setv({ start: low - more, end: high + more, reset_start: low - more, reset_end: high + more });
  }

  function drawMargins() {
    if (!page.balance) return;
    const phases = page.phases.filter(([phase]) => phase in page.shades);
    set("phases", {
      start: phases.map(([, start]) => start), stop: phases.map(([, , stop]) => stop),
      shade: phases.map(([phase]) => page.shades[phase]), phase: phases.map(([phase]) => phase),
    });
    const data = named("balance").data;
    const margin = Array.from(data.margin_of_stability_m, (value) => 1000 * value);
    set("margins", { time: Array.from(columns.time), margin });
    fit("margin", [0, ...margin.filter((value) => value > -200)], 0.1); // walking goes far below
  }

  // ---- the pendulum ----

  // Recorded second of a knot: a movement that is played in one second is shown where it was recorded.
  const secondOf = (knot) => page.deposit[0] + (knot / (loop.level.length - 1)) * (page.deposit[1] - page.deposit[0]);

  function knotNow() {
    const last = loop.level.length - 1;
    const share = (time - page.deposit[0]) / (page.deposit[1] - page.deposit[0]);
    return Math.min(Math.max(Math.round(share * last), 0), last);
  }

  function load(key) {
    if (!(key in page.pendulums)) return null;
    return { key, ...page.pendulums[key], ...named(`loop:${key}`).data, level: named(`level:${key}`).data.level };
  }

  function chooseState() {
    const plane = chosen("plane");
    for (const [name, column] of [["angles", "angle"], ["velocities", "velocity"]]) {
      const found = Object.keys(page.segments).map((com) => [com, named(`states:${com}/${plane}`)]);
      const known = found.filter(([, source]) => source !== null);
      const data = Object.fromEntries(found.map(([com, source]) => [com, source === null ? [] : Array.from(source.data[column])]));
      data.time = known.length ? Array.from(known[0][1].data.time) : [];
      for (const com of Object.keys(page.segments)) if (!data[com].length) data[com] = data.time.map(() => NaN);
      set(name, data);
      fit(column, Object.keys(page.segments).flatMap((com) => data[com]).filter(Number.isFinite), 0.08);
    }
  }

  function choosePendulum() {
    loop = load(`${chosen("com")}/${chosen("plane")}`);
    push = null;
    for (const box of document.querySelectorAll("input[name=com]")) box.disabled = !(`${box.value}/${chosen("plane")}` in page.pendulums);
    element("limited").disabled = loop === null;
    element("pushing").hidden = loop === null;
    element("no-funnel").hidden = loop !== null;
    if (loop === null) return;
    element("limits").textContent = `(${digits(loop.lowest)} to ${digits(loop.highest)} N·m)`;
    const last = loop.level.length - 1;
    const even = Array.from({ length: page.outlines }, (_, i) => Math.round((i * last) / (page.outlines - 1)));
    const drawn = even.map((knot) => closed(ellipse(loop, knot, loop.level[knot], 80)));
    set("outlines", { x: drawn.map(({ x }) => x), y: drawn.map(({ y }) => y), alpha: even.map((_, i) => 0.25 + (0.5 * i) / page.outlines) });
    set("goal", closed(ellipse(loop, last, loop.level[last], 80)));
    whole = drawn;
    zoom();
    simulateOutlines();
    // A first push to look at, inside the funnel: a change of velocity.
    const knot = knotNow();
    pushTo([0, 0.6 * Math.sqrt(loop.level[knot] / loop.s22[2 * knot])]);
  }

  const closed = (states) => {
    const all = [...states, states[0]];
    return { x: all.map(([e]) => e), y: all.map(([, w]) => w) };
  };
  const limited = () => element("limited").checked;

  function simulateOutlines() {
    outlines = reached(loop, limited(), POINTS);
    const last = loop.level.length - 1;
    const band = { time: [], low: [], high: [], least: [], most: [] };
    for (let knot = 0; knot <= last; knot++) {
      const determinant = loop.s11[2 * knot] * loop.s22[2 * knot] - loop.s12[2 * knot] ** 2;
      const reach = Math.sqrt((loop.level[knot] * loop.s22[2 * knot]) / determinant);
      const angles = outlines[knot].map(([e]) => e);
      const row = [secondOf(knot), -reach, reach, Math.min(...angles), Math.max(...angles)];
      Object.keys(band).forEach((name, i) => band[name].push(row[i]));
    }
    set("band", band);
  }

  const near = () => element("zoom").getAttribute("aria-pressed") === "true";

  // Show the whole funnel, or the present cross-section.
  function zoom() {
    const knot = knotNow();
    const shown = near() ? [closed(ellipse(loop, knot, loop.level[knot], 80))] : whole;
    for (const [axis, range] of [["x", named("plane").x_range], ["y", named("plane").y_range]]) {
      const reach = 1.5 * Math.max(...shown.flatMap((outline) => outline[axis]));
      range.setv({ start: -reach, end: reach });
    }
  }

  // The cross-section at the present instant, and where the pushed pendulum is.
  function drawSection() {
    if (loop === null) return;
    const knot = knotNow();
    set("certified", closed(ellipse(loop, knot, loop.level[knot], 80)));
    set("reached", closed(outlines[knot]));
    element("section").textContent = `Cross-section at ${clock(secondOf(knot))} s` +
      (time < page.deposit[0] || time > page.deposit[1] ? ": the pendulum is that of the deposit alone." : ".");
    if (push === null) return;
    const after = knot - push.knot;
    const state = after >= 0 && after < push.path.length ? push.path[after] : [0, 0];
    set("present", { x: [state[0]], y: [state[1]] });
  }

  // ---- the push ----

  function pushTo(state) {
    const last = loop.level.length - 1;
    const knot = Math.min(knotNow(), last - 1);
    push = { knot, state, path: follow(loop, knot, state, limited()) };
    for (const [id, value] of [["push-angle", state[0]], ["push-velocity", state[1]]]) {
      if (document.activeElement !== element(id)) element(id).value = Number(value.toFixed(4)); // else what is typed is overwritten
    }
    element("too-far").textContent = "";
    set("pushed", { x: [state[0]], y: [state[1]] });
    set("path", {
      time: push.path.map((_, i) => secondOf(knot + i)),
      angle: push.path.map(([e]) => e), velocity: push.path.map(([, w]) => w),
      level: push.path.map((at, i) => Math.max(level(loop, knot + i, at), 1e-4)), // for the logarithm
    });
    drawSection();
    if (!dragging) tell();
  }

  function again() {
    if (loop === null) return;
    simulateOutlines();
    const { knot, state } = push;
    push.path = follow(loop, knot, state, limited());
    const present = time;
    time = secondOf(knot);
    pushTo(state);
    time = present;
    drawSection();
  }

  function certainty(start) {
    const inside = start <= EDGE;
    const where = `${inside ? "inside" : "outside"} the funnel (V/ρ = ${digits(start)})`;
    if (!inside) return `${where}: nothing is certified. It may return all the same.`;
    if (!limited()) return `${where}: it stays inside and ends in the goal set.`;
    return loop.binds
      ? `${where}, which is that of the loop without limits: with them nothing is certified.`
      : `${where}: it stays inside and ends in the goal set, for inside the funnel the torque's limits are not reached.`;
  }

  function simulated(path, knot) {
    const levels = path.map((state, i) => level(loop, knot + i, state));
    if (!levels.every(Number.isFinite)) return "the simulation breaks off: the state leaves all bounds.";
    const inside = levels.map((value) => value <= EDGE);
    const said = [];
    const leaves = inside.findIndex((here, i) => i > 0 && inside[i - 1] && !here);
    const enters = inside.findIndex((here, i) => i > 0 && !inside[i - 1] && here);
    const when = (i) => `at ${clock(secondOf(knot + i))} s`;
    if (leaves < 0 && enters < 0) said.push(inside[0] ? "does not leave the funnel" : "is outside the funnel throughout");
    else if (inside[0]) said.push(`leaves the funnel ${when(leaves)}` + (enters > 0 ? ` and is back ${when(enters)}` : ""));
    else said.push(`enters the funnel ${when(enters)}` + (leaves > 0 ? ` and leaves it ${when(leaves)}` : ""));
    const fallen = path.findIndex(([e], i) => Math.abs(loop.angle[2 * (knot + i)] + e) >= Math.PI / 2);
    if (fallen >= 0) said.push(`is horizontal ${when(fallen)}`);
    const end = levels[levels.length - 1];
    said.push(end <= EDGE ? "ends in the goal set" : `does not end in the goal set (V/ρ = ${digits(end)} at the release)`);
    return `${said.slice(0, -1).join(", ")}, and ${said[said.length - 1]}.`;
  }

  function torques(path, knot) {
    const values = path.map(([e, w], i) => torque(loop, 2 * (knot + i), e, w, limited()));
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const range = `Torque about the pivot from ${digits(low)} to ${digits(high)} N·m`;
    if (!limited()) {
      return low < loop.lowest || high > loop.highest
        ? `${range}: beyond the limits of ${digits(loop.lowest)} to ${digits(loop.highest)} N·m, which do not count here.` : `${range}.`;
    }
    const full = values.filter((value) => value <= loop.lowest || value >= loop.highest).length;
    return full ? `${range}, at a limit for ${digits((100 * full) / values.length, 2)} % of the time.` : `${range}, at no limit.`;
  }

  function tell() {
    if (push === null) return;
    const { angle: angles, level: levels } = named("path").data;
    const certified = named("band").data.high;
    fit("funnel", [...angles, ...certified, ...certified.map((value) => -value)], 0.15);
    named("level").y_range.setv({ start: 0.5 * Math.min(...levels, 0.1), end: 2 * Math.max(...levels, 2) });
    const [e, w] = push.state;
    const impulse = loop.mass * loop.length * w;
    element("told-push").textContent = `Pushed at ${clock(secondOf(push.knot))} s: ${digits(e)} rad and ${digits(w)} rad/s off the ` +
      `trajectory. That change of velocity takes an impulse of ${digits(impulse)} N·s across the pendulum at its centre of mass.`;
    element("told-certified").textContent = certainty(level(loop, push.knot, push.state));
    element("told-simulated").textContent = simulated(push.path, push.knot);
    element("told-torque").textContent = torques(push.path, push.knot);
  }

  function typed() {
    const fields = [element("push-angle"), element("push-velocity")];
    const wrong = fields.find(({ validity, value }) => value === "" || validity.rangeUnderflow || validity.rangeOverflow);
    element("too-far").textContent = wrong ? `From ${wrong.min} to ${wrong.max}.`.replaceAll("-", "−") : "";
    if (loop !== null && !wrong) pushTo(fields.map((field) => field.valueAsNumber));
  }

  function dragged({ event_name: kind, x, y }) {
    if (loop === null || x === null || y === null) return;
    pause();
    dragging = kind === "panstart" || kind === "pan";
    const { x_range, y_range } = named("plane");
    const within = (value, { start, end }) => Math.min(Math.max(value, start), end); // not out of the picture
    pushTo([within(x, x_range), within(y, y_range)]);
  }

  function tapped({ x }) { pause(); seek(x); }

  // ---- start ----

  function clicked(event) {
    const button = event.target.closest("button");
    if (button === null) return;
    if (button.dataset.seek !== undefined) { pause(); seek(Number(button.dataset.seek)); }
    if (button.id === "play") play();
    if (button.id === "no-push" && loop !== null) pushTo([0, 0]);
    if (button.id === "zoom" && loop !== null) {
      button.setAttribute("aria-pressed", !near());
      zoom();
    }
  }

  function start() {
    const found = window.Bokeh && window.Bokeh.documents.find((item) => item.get_model_by_name("body") !== null);
    if (!found) { window.setTimeout(start, 20); return; }
    pictures = found;
    columns = named("body").data;
    const times = columns.time;
    const slider = element("time");
    [slider.min, slider.max, slider.step] = [times[0], times[times.length - 1], 0.01];
    slider.addEventListener("input", () => { pause(); seek(Number(slider.value)); });
    document.addEventListener("click", clicked);
    for (const box of document.querySelectorAll("input[name=plane]")) {
      box.addEventListener("change", () => { chooseState(); choosePendulum(); seek(time); });
    }
    for (const box of document.querySelectorAll("input[name=com]")) {
      box.addEventListener("change", () => { choosePendulum(); seek(time); });
    }
    element("limited").addEventListener("change", again);
    for (const id of ["push-angle", "push-velocity"]) element(id).addEventListener("input", typed);
    window.lumbarDark(pictures);
    for (const [name, axis] of [["side", "y"], ["behind", "x"]]) set(`${name}:bounds`, { x: page.bounds[axis], y: page.bounds.z });
    drawMargins();
    const ends = page.deposit || [times[0], times[times.length - 1]];
    named("margin").x_range.setv({ start: times[0], end: times[times.length - 1], reset_start: times[0], reset_end: times[times.length - 1] });
    for (const name of ["angle", "funnel"]) {
      const [first, last] = [ends[0] - 0.05, ends[1] + 0.05];
      named(name).x_range.setv({ start: first, end: last, reset_start: first, reset_end: last });
    }
    time = page.deposit ? page.deposit[0] : times[0];
    chooseState();
    choosePendulum();
    seek(time);
    watch();
    document.body.dataset.ready = "yes";
  }

  start();
  return {
    dragged, tapped, seek,
    follow: (key, knot, state, limits) => follow(load(key), knot, state, limits),
    reached: (key, limits, count) => reached(load(key), limits, count),
  };
})();
