// What the page does by itself: shows another record or model, marks a region everywhere, adds what was fitted already.
// Where it is served, it asks the server for what was not.
"use strict";
window.lumbar = (() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const element = (id) => document.getElementById(id);
  const CELLS = 24;
  let pictures; // Bokeh's document
  let added = page.selected.slice();
  const past = [];
  let asked = 0;
  let windowed; // record of which the beginning was shown already

  const named = (name) => pictures.get_model_by_name(name);
  const keyOf = (effects) => effects.slice().sort().join("+") || "base";
  const readable = (effects) => effects.map((name) => name.replaceAll("_", " ")).join(" and ") || "no effect";
  const digits = (value) => (value === null ? "unknown" : Number(value).toPrecision(3));

  function show() {
    const record = element("record").value;
    const first = element("first").value;
    const second = element("second").value;
    const data = named("record:" + record).data;
    const less = (key) => data.measured.map((value, i) => value - data[key][i]);
    named("shown").data = {
      time: data.time, position: data.position, velocity: data.velocity, measured: data.measured,
      first: data[first], second: data[second], first_error: less(first), second_error: less(second),
    };
    const lines = named("spectrum:" + record).data;
    named("lines").data = { frequency: lines.frequency, noise: lines.noise, first: lines[first], second: lines[second] };
    const duration = data.time[data.time.length - 1];
    if (record !== windowed) {
      const end = Math.min(duration, page.window_s);
      named("course").x_range.setv({ start: 0, end, reset_start: 0, reset_end: duration });
    }
    windowed = record;
    shade();
    brushed([]);
    merits(record, first, second);
    told(first, record);
  }

  // Mean squared error of the first model in cells of position and velocity.
  function shade() {
    const { position, velocity, first_error } = named("shown").data;
    const [x, y] = [span(position), span(velocity)];
    const sums = new Map();
    first_error.forEach((error, i) => {
      const column = Math.min(CELLS - 1, Math.floor((position[i] - x.low) / x.step));
      const row = Math.min(CELLS - 1, Math.floor((velocity[i] - y.low) / y.step));
      const cell = sums.get(row * CELLS + column) || [0, 0];
      sums.set(row * CELLS + column, [cell[0] + error * error, cell[1] + 1]);
    });
    const cells = { position: [], velocity: [], width: [], height: [], rms: [] };
    for (const [place, [sum, count]] of sums) {
      cells.position.push(x.low + ((place % CELLS) + 0.5) * x.step);
      cells.velocity.push(y.low + (Math.floor(place / CELLS) + 0.5) * y.step);
      cells.width.push(x.step);
      cells.height.push(y.step);
      cells.rms.push(Math.sqrt(sum / count));
    }
    named("cells").data = cells;
    const shading = named("shading");
    shading.high = Math.max(...cells.rms, 1e-12);
  }

  function span(values) {
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    return { low, step: (high - low) / CELLS || 1 };
  }

  function brush(across, up, event) {
    if (!event.final || event.geometry.type !== "rect") return;
    const { x0, x1, y0, y1 } = event.geometry;
    const data = named("shown").data;
    const inside = [];
    for (let i = 0; i < data.time.length; i++) {
      const [x, y] = [data[across][i], data[up][i]];
      if (x >= x0 && x <= x1 && y >= y0 && y <= y1) inside.push(i);
    }
    brushed(inside);
  }

  function brushed(inside) {
    const data = named("shown").data;
    named("brushed").data = Object.fromEntries(Object.keys(data).map((name) => [name, inside.map((i) => data[name][i])]));
    const rms = (name) => Math.sqrt(inside.reduce((sum, i) => sum + data[name][i] ** 2, 0) / inside.length);
    element("region").textContent = inside.length === 0
      ? "Draw a box in a picture to mark the same samples in all of them."
      : `${inside.length} samples marked: error ${digits(rms("first_error"))} ${page.unit} RMS with the first model, ` +
        `${digits(rms("second_error"))} ${page.unit} with the second.`;
  }

  function row(cells, head) {
    const line = document.createElement("tr");
    for (const text of cells) {
      const cell = document.createElement(head ? "th" : "td");
      cell.textContent = text;
      line.append(cell);
    }
    return line;
  }

  function merits(record, first, second) {
    const rows = [row(["model", `RMS error (${page.unit})`, "of the noise", "VAF (%)", "FIT (%)"], true)];
    for (const key of [first, second]) {
      const { label, merits: all } = page.models[key];
      const { rms, vaf, fit } = all[record];
      const noise = page.noise_rms === null ? "unknown" : `${digits(rms / page.noise_rms)} ×`;
      rows.push(row([label, digits(rms), noise, vaf.toPrecision(5), digits(fit)], false));
    }
    element("merits").replaceChildren(...rows);
  }

  // What locate says of the first model on this record.
  function told(key, record) {
    const lines = page.models[key].located[record] || ["Where this model fails was not put into words: see the pictures."];
    element("located").replaceChildren(...lines.map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
  }

  function rungs(effects) {
    const steps = effects.map((_, i) => effects.slice(0, i + 1));
    return [[], ...steps].filter((step) => keyOf(step) in page.models);
  }

  function ladder() {
    const steps = rungs(added);
    const top = page.models.base.test_rms;
    const items = steps.map((effects, i) => {
      const { train_rms, test_rms } = page.models[keyOf(effects)];
      const item = document.createElement("li");
      const track = document.createElement("span");
      track.className = "track";
      const bar = document.createElement("span");
      bar.className = "bar";
      bar.style.width = `${Math.min(100, (100 * test_rms) / top)}%`;
      track.append(bar);
      const noise = page.noise_rms === null ? "" : `, ${digits(test_rms / page.noise_rms)} × noise`;
      const words = document.createElement("span");
      const name = i === 0 ? page.base : "+ " + readable(effects.slice(steps[i - 1].length));
      words.textContent = `${name}: ${digits(test_rms)} ${page.unit} unseen (${digits(train_rms)} in training${noise})`;
      item.append(words, track);
      return item;
    });
    element("ladder").replaceChildren(...items);
    if (page.noise_rms !== null) {
      element("ladder").style.setProperty("--noise", `${Math.min(100, (100 * page.noise_rms) / top)}%`);
    }
    element("undo").disabled = past.length === 0;
    element("remove").disabled = added.length === 0;
    for (const button of document.querySelectorAll("[data-needs-effects]")) button.disabled = added.length === 0;
  }

  function say(text, bad) {
    element("message").textContent = text;
    element("message").className = bad ? "bad" : "";
  }

  function take(effects, remember = true) {
    if (!(keyOf(effects) in page.models)) {
      if (!page.served) {
        say(`${readable(effects)} together were not fitted in this diagnosis. "lumbar explore" fits them.`, true);
        return;
      }
      ask({ action: "fit", effects });
      return;
    }
    if (remember) past.push(added);
    added = effects;
    const { label, test_rms } = page.models[keyOf(effects)];
    say(`${label}: error on unseen records ${digits(test_rms)} ${page.unit}.`);
    element("second").value = keyOf(effects);
    ladder();
    show();
  }

  function ask(content) {
    if (document.body.hasAttribute("aria-busy")) return; // one thing after the other: the answer to the first counts
    asked += 1;
    say("Computing …");
    document.body.setAttribute("aria-busy", "true");
    named("request").data = { content: [JSON.stringify({ number: asked, ...content })] };
  }

  function answered(text) {
    const answer = JSON.parse(text);
    if (answer.number !== asked) return;
    document.body.removeAttribute("aria-busy");
    if (answer.error) { say(answer.error, true); return; }
    if (answer.model) {
      page.models[answer.key] = answer.model;
      for (const id of ["first", "second"]) offer(element(id), answer.key);
      take(answer.effects);
    }
    if (answer.text !== undefined) say(answer.text);
    const proposal = element("proposal");
    proposal.hidden = answer.diff === undefined;
    if (answer.diff !== undefined) element("diff").textContent = answer.diff;
  }

  function offer(select, key) {
    if ([...select.options].some((option) => option.value === key)) return;
    select.append(new Option(page.models[key].label, key));
  }

  function clicked(event) {
    const button = event.target.closest("button");
    if (button === null) return;
    const { show: shown, add, ask: action } = button.dataset;
    if (shown !== undefined) { element("second").value = shown; show(); element("compare").scrollIntoView(); }
    if (add !== undefined) {
      const more = JSON.parse(add).filter((name) => !added.includes(name));
      if (more.length === 0) say(`${readable(JSON.parse(add))}: in the model already.`);
      else take([...added, ...more]);
    }
    if (action !== undefined) ask({ action, effects: added, first: element("first").value, record: element("record").value });
    if (button.id === "undo") take(past.pop(), false);
    if (button.id === "remove") take(added.slice(0, -1));
    if (button.id === "restart") take([]);
  }

  function start() {
    const found = window.Bokeh && window.Bokeh.documents.find((item) => item.get_model_by_name("shown") !== null);
    if (!found) { window.setTimeout(start, 20); return; }
    pictures = found;
    document.addEventListener("click", clicked);
    for (const id of ["record", "first", "second"]) element(id).addEventListener("change", show);
    window.lumbarDark(pictures);
    ladder();
    show();
    document.body.dataset.ready = "yes";
  }

  start();
  return { brush, answered };
})();
