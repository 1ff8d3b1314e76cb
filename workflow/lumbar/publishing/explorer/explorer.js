// What the page does by itself: adds and removes effects, shows another record, hands out files.
// Where it is served, it asks the server for what was not computed.
"use strict";
window.lumbar = (() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const element = (id) => document.getElementById(id);
  let pictures; // Bokeh's document
  let added = []; // the path: effects in the order in which they were added
  let aside = null; // a path that was set aside, to be compared
  let asked = false; // whether the user asked for the best model
  const past = [];
  let number = 0; // of the last request to the server
  let since; // when it was sent
  let playing; // timer of the automatic path
  let windowed; // record with the time that is shown
  let opening = null; // what the address asks for, while the server fits it
  let session; // the address that was written last

  const named = (name) => pictures.get_model_by_name(name);
  const keyOf = (effects) => effects.slice().sort().join("+") || "base";
  const readable = (effects) => effects.map((name) => name.replaceAll("_", " ")).join(" and ") || "no effect";
  const digits = (value) => (value === null ? "unknown" : String(Number(Number(value).toPrecision(3))));
  const known = (effects) => keyOf(effects) in page.models;
  const steps = (effects) => [[], ...effects.map((_, i) => effects.slice(0, i + 1))];
  const current = () => page.models[keyOf(added)];
  const inPrint = (text) => text.replace(/(?<![\w.)])-(?=\d)/g, "−");
  const hue = (key, other) => window.lumbarHue(key === "base" ? page.colours.base : other ? page.colours.other : page.colours.effects);
  // What is drawn is the page's own: nothing of it is compared with what was there, or sent to a server.
  const put = (name, data) => named(name).setv({ data }, { check_eq: false, sync: false });
  let whole; // all samples of the record that is shown
  const where = window.lumbarWhere(() => whole, named, put, digits, page);

  function made(tag, text, attributes = {}) {
    const node = document.createElement(tag);
    node.textContent = text;
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    return node;
  }

  // The model that is compared: a chosen one, the end of the path that was set aside, or the model before the last step.
  function compared() {
    const chosen = element("other").value;
    if (chosen !== "") return chosen === keyOf(added) ? null : chosen;
    const before = aside ?? steps(added).slice(0, -1).filter(known).at(-1);
    return before === undefined || keyOf(before) === keyOf(added) ? null : keyOf(before);
  }

  function errorOf(data, record, key) {
    const scale = page.models[key].scales[record];
    return Float32Array.from(data[key], (value) => value * scale);
  }

  function show() {
    const record = element("record").value;
    const [key, other] = [keyOf(added), compared()];
    const data = named("record:" + record).data;
    const error = errorOf(data, record, key);
    const base_error = errorOf(data, record, "base");
    const other_error = other === null ? error.map(() => NaN) : errorOf(data, record, other);
    const less = (values) => values.map((value, i) => data.measured[i] - value);
    const turned = (values) => values.map((value, i) => value * data.turned[i]);
    whole = {
      time: data.time, position: data.position, velocity: data.velocity, since: data.since, measured: data.measured,
      model: less(error), other: less(other_error), model_error: error, other_error, base_error,
      model_turned: turned(error), other_turned: turned(other_error),
    };
    const { frequency, noise, marker, ...lines } = named("spectrum:" + record).data;
    put("lines", { frequency, noise, marker, model: lines[key], other: other === null ? frequency.map(() => NaN) : lines[other] });
    element("name-model").textContent = page.models[key].label;
    element("name-other").textContent = other === null ? "" : page.models[other].label;
    document.querySelector(".curve.other").hidden = other === null;
    for (const [curve, colour] of [["model", hue(key)], ["other", hue(other, true)]]) {
      document.querySelector(`.curve.${curve}`).style.setProperty("--hue", colour);
      for (const { glyph } of drawn(curve)) {
        for (const name of ["line_color", "fill_color"]) if (name in glyph) glyph.setv({ [name]: colour }, { sync: false });
      }
    }
    if (record !== windowed) worst();
    windowed = record;
    inWindow();
    where.draw();
    element("region").textContent = where.nothing();
    verdict(key);
    told(key, record);
    ladder();
    chips();
    element("parameters").innerHTML = current().parameters;
    merits();
    reachable();
    remember();
  }

  const drawn = (curve) => pictures.roots().flatMap(({ renderers }) => renderers.filter((item) => item.name === curve));

  function switched({ target: { dataset, checked } }) {
    for (const item of drawn(dataset.curve)) item.setv({ visible: checked }, { sync: false });
  }

  // Three figures and one sentence: on the model that is shown, and what the search found when the user is there.
  function verdict(key) {
    const [base, model] = [page.models.base, page.models[key]];
    const isSolved = page.solved.includes(key) || (asked && key === keyOf(page.selected));
    const { chip, tone, sentence } = isSolved ? page.verdict : model;
    element("verdict").dataset.tone = page.noise_rms === null && !isSolved ? "" : tone;
    element("chip").textContent = chip;
    element("sentence").textContent = inPrint(sentence);
    element("fall").textContent = (key === "base" ? "" : `${digits(base.test_rms)} → `) + `${digits(model.test_rms)} ${page.unit}`;
    element("times").textContent = page.noise_rms === null ? "unknown" : `${ofNoise(model.test_rms)} ×`;
    element("chance").textContent = model.chance || "–";
    element("best").disabled = isSolved;
    const step = isSolved ? "" : key === "base" ? "#add" : "#again";
    for (const link of document.querySelectorAll(".stepper a")) {
      if (link.hash === step) link.setAttribute("aria-current", "step");
      else link.removeAttribute("aria-current");
    }
  }

  // Where the model fails on this record: the headline, and effects that one could add; further sentences under the pictures.
  function told(key, record) {
    const { headline, places, views } = page.models[key].located[record];
    element("headline").textContent = inPrint(headline);
    element("places").replaceChildren(...places.flatMap(([place, effects]) => {
      const offered = effects.filter((name) => name in page.effects && !added.includes(name)).sort(byError).slice(0, 2);
      const group = made("span", `${place} ${offered.length ? "→ " : ""}`);
      group.append(...offered.map((name) => made("button", readable([name]), { "data-add": name })));
      return [group];
    }));
    const left = { ...views };
    for (const place of document.querySelectorAll("[data-view]")) {
      place.textContent = inPrint(left[place.dataset.view] || "");
      delete left[place.dataset.view];
    }
    element("other-views").replaceChildren(...Object.values(left).map((text) => made("li", inPrint(text))));
  }

  const withEffect = (name) => page.models[keyOf([...added, name])];
  const byError = (a, b) => (withEffect(a)?.test_rms ?? Infinity) - (withEffect(b)?.test_rms ?? Infinity) || 0;

  // One chip per effect, sorted by the error that it leaves together with the model; then what was not fitted with it.
  function chips() {
    const { train_rms, test_rms } = current();
    const names = Object.keys(page.effects).filter((name) => !added.includes(name)).sort(byError);
    const fitted = names.filter((name) => withEffect(name) !== undefined);
    const others = names.filter((name) => withEffect(name) === undefined && page.effects[name].reason === "");
    const chip = (name) => made("button", readable([name]), { "data-add": name, title: page.effects[name].about });
    element("chips").replaceChildren(...fitted.map((name) => {
      const [node, model] = [chip(name), withEffect(name)];
      node.append(" ", made("b", digits(model.test_rms)));
      if (model.train_rms < train_rms && model.test_rms >= test_rms) node.append(made("small", " only training gains"));
      node.style.setProperty("--share", `${Math.min(100, (100 * model.test_rms) / page.models.base.test_rms)}%`);
      return node;
    }));
    element("others").hidden = others.length === 0;
    element("others").replaceChildren(element("others").firstElementChild, ...others.map(chip));
    const untried = names.filter((name) => page.effects[name].reason !== "");
    element("untried").textContent = untried.map((name) => `${readable([name])}: not tried, ${page.effects[name].reason}`).join("; ");
  }

  // The address contains the state of the page: a reload, a bookmark or a link restores it.
  function remember() {
    if (opening !== null) return; // not there yet
    const record = element("record");
    const state = {
      path: added.join(" "), aside: aside === null ? "" : aside.join(" ") || "base",
      record: record.value === record.options[0].value ? "" : record.value, compare: element("other").value,
    };
    const text = String(new URLSearchParams(Object.entries(state).filter(([, value]) => value !== "")));
    if (session === undefined && text === "") return;
    session = text === "" ? "" : `#${text}`;
    try { history.replaceState(null, "", session || "#"); } catch { /* a frame whose address is not its own */ }
    if (window.parent !== window) window.parent.postMessage({ lumbar: session }, "*");
  }

  // Reads the address; a link within the page is followed, and the address then is what it was.
  function reopened() {
    if (!location.hash.includes("=")) {
      if (session) history.replaceState(null, "", session);
    } else if (location.hash !== session) {
      opening = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
      open();
    }
  }

  function refused(words) {
    opening = null;
    say(`The address cannot be followed: ${words}. What is shown is what could be.`, true);
  }

  // Shows what the address asks for, after the server fitted what is not there.
  function open() {
    const effects = (text) => (text === "base" ? [] : text.split(" "));
    const { path = "base", aside: other, record = element("record").options[0].value, compare = "", ...strange } = opening;
    for (const name of Object.keys(strange)) { refused(`it knows no “${name}”`); return; }
    for (const wanted of [path, other ?? "base"].map(effects)) {
      if ((page.served ? steps(wanted) : [wanted]).every(known)) continue;
      if (new Set(wanted).size < wanted.length) refused(`${readable(wanted)} names an effect twice`);
      else if (!page.served) refused(`this diagnosis did not fit ${readable(wanted)}; "lumbar explore" fits effects of the catalogue`);
      else ask({ action: "fit", effects: wanted }, `Fitting ${page.base} with ${readable(wanted)}, as the address asks`);
      return;
    }
    for (const [id, value] of [["record", record], ["other", compare]]) {
      if ([...element(id).options].some((option) => option.value === value)) element(id).value = value;
      else { refused(`there is no ${id === "record" ? "record" : "model"} “${value}”`); return; }
    }
    opening = null;
    aside = other === undefined ? null : effects(other);
    take(effects(path), false);
  }

  // The two seconds with the largest error of the model, without the start that does not count.
  function worst() {
    const { time, model_error: error } = whole;
    const count = Math.min(time.length, Math.max(100, Math.min(2000, Math.round(2 / (time[1] - time[0])))));
    const first = Math.max(0, time.findIndex((value) => value >= page.settling_s[element("record").value]));
    let [sum, most, end] = [0, -1, time.length - 1];
    for (let i = first; i < time.length; i++) {
      sum += error[i] ** 2;
      if (i - count >= first) sum -= error[i - count] ** 2;
      if (i - first >= count - 1 && sum > most) [most, end] = [sum, i];
    }
    zoom(time[Math.max(0, end - count + 1)], time[end]);
  }

  const zoom = (start, end) => named("course").x_range.setv({ start, end });

  function zoomed(way) {
    const { start, end } = named("course").x_range;
    const [middle, half] = [(start + end) / 2, ((end - start) / 2) * (way === "in" ? 0.5 : 2)];
    if (way === "worst") worst();
    else if (way === "whole") zoom(whole.time[0], whole.time[whole.time.length - 1]);
    else zoom(middle - half, middle + half);
  }

  // Lines and loops are drawn of the time that is shown alone: a long record would take a second.
  function inWindow() {
    const { start, end } = named("course").x_range;
    const [first, last] = [start, end].map((time) => whole.time.findIndex((value) => value >= time));
    const until = last < 0 ? whole.time.length : last + 1;
    const shown = Object.fromEntries(Object.entries(whole).map(([name, values]) => [name, values.slice(Math.max(first - 1, 0), until)]));
    const { base_error, ...lines } = shown;
    put("shown", lines);
    // The range of the residual is that of the base: an effect that helps makes it smaller.
    let top = page.noise_rms ?? 0;
    for (const values of [base_error, shown.model_error]) for (const value of values) top = Math.max(top, 1.1 * Math.abs(value));
    named("residual").y_range.setv({ start: -top || -1, end: top || 1 });
  }

  // Once a frame, however often the range changes.
  let waits = false;
  function moved() {
    if (waits || whole === undefined) return;
    waits = true;
    requestAnimationFrame(() => { waits = false; inWindow(); });
  }

  function brush(across, up, event) {
    if (event.final && event.geometry.type === "rect") element("region").textContent = where.box(across, up, event.geometry);
  }

  function brushBand(event) {
    if (event.final && event.geometry.type === "rect") element("region").textContent = where.band(event.geometry);
  }

  function brushTime() {
    const ends = [element("from").valueAsNumber, element("to").valueAsNumber];
    if (ends.some(Number.isNaN)) element("region").textContent = where.nothing();
    else element("region").textContent = where.between(Math.min(...ends), Math.max(...ends));
  }

  const part = (record) => (page.trained.includes(record) ? "training" : "unseen");
  const ofNoise = (rms) => (rms < 10 * page.noise_rms ? (rms / page.noise_rms).toFixed(2) : rms < 1000 * page.noise_rms ? (rms / page.noise_rms).toFixed(0) : "> 1000");

  function row(cells, tag, attributes) {
    const line = made("tr", "");
    line.append(...cells.map((text) => made(tag, text, attributes)));
    return line;
  }

  // RMS error of every model on every record; the model that is shown is in bold.
  function merits() {
    const records = Object.keys(page.models.base.merits);
    const [head, body] = [made("thead", ""), made("tbody", "")];
    head.append(row([`RMS error (${page.unit})`, ...records.map((name) => `${name} (${part(name)})`)], "th", { scope: "col" }));
    const rank = ({ group, test_rms }) => test_rms + (group === page.models.base.group ? 0 : 1e9);
    for (const [key, { label, merits: all }] of Object.entries(page.models).sort(([, a], [, b]) => rank(a) - rank(b))) {
      const line = row(records.map((name) => digits(all[name].rms)), "td");
      line.prepend(made("th", label, { scope: "row" }));
      if (key === keyOf(added)) line.setAttribute("aria-current", "true");
      body.append(line);
    }
    element("merits").replaceChildren(head, body);
  }

  // Every model on every record, as a file.
  function table() {
    const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const lines = [["model", "group", "record", "part", `rms_${page.unit}`, "rms_of_noise", "vaf_percent", "fit_percent"]];
    for (const { label, group, effects, merits: all } of Object.values(page.models)) {
      const name = group === page.models.base.group ? [page.base, ...effects].join("+") : label;
      for (const [record, { rms, vaf, fit }] of Object.entries(all)) {
        const noise = page.noise_rms === null ? "" : rms / page.noise_rms;
        lines.push([name, group, record, part(record), rms, noise, vaf, fit]);
      }
    }
    hand("models.csv", "text/csv", lines.map((line) => line.map((cell) => quoted(String(cell))).join(",") + "\n").join(""));
  }

  function hand(name, type, content) {
    const link = made("a", "", { download: name, href: URL.createObjectURL(new Blob([content], { type })) });
    link.click();
    window.setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  // A picture as it stands on the screen.
  async function picture(name) {
    const { id } = named(name);
    const canvas = window.Bokeh.index.get_by_id(id).export("svg", true);
    hand(`${name}.svg`, "image/svg+xml", await canvas.to_blob());
  }

  function rung(effects, before, top, place) {
    const { train_rms, test_rms } = page.models[keyOf(effects)];
    const item = made("li", "", { title: `${digits(train_rms)} ${page.unit} in training` });
    const line = made("div", "", { class: "rung" });
    line.append(made("span", before === null ? page.base : "+ " + readable(effects.slice(before.length))));
    if (place !== undefined) {
      const tools = made("span", "", { class: "tools" });
      const effect = effects[effects.length - 1];
      for (const [action, sign, words] of [["up", "↑", "earlier"], ["down", "↓", "later"], ["out", "✕", "out"]]) {
        const button = made("button", sign, { "data-move": action, "data-effect": effect, "aria-label": `${readable([effect])} ${words}` });
        button.disabled = (action === "up" && place === 1) || (action === "down" && place === added.length);
        tools.append(button);
      }
      line.append(tools);
    }
    line.append(made("b", `${digits(test_rms)} ${page.unit}`));
    const bar = made("span", "", { class: "bar" });
    bar.style.setProperty("--hue", hue(keyOf(effects)));
    bar.style.setProperty("--before", `${before === null ? 100 : (100 * page.models[keyOf(before)].test_rms) / top}%`);
    bar.style.width = `${(100 * test_rms) / top}%`;
    const track = made("span", "", { class: "track" });
    track.append(bar);
    item.append(line, track);
    return item;
  }

  function fill(list, effects, movable) {
    const rungs = steps(effects).filter(known);
    const top = Math.max(page.noise_rms ?? 0, ...rungs.map((step) => page.models[keyOf(step)].test_rms));
    const items = rungs.map((step, i) => rung(step, i === 0 ? null : rungs[i - 1], top, movable && i > 0 ? step.length : undefined));
    const axis = made("li", "0", { class: "axis" });
    if (page.noise_rms !== null) {
      list.style.setProperty("--noise", `${(100 * page.noise_rms) / top}%`);
      axis.append(made("span", `dashed: noise, ${digits(page.noise_rms)} ${page.unit}`));
    }
    list.classList.toggle("floor", page.noise_rms !== null);
    axis.append(made("span", `${digits(top)} ${page.unit}`));
    list.replaceChildren(...items, axis);
  }

  function ladder() {
    fill(element("ladder"), added, true);
    element("undo").disabled = past.length === 0;
    element("restart").disabled = added.length === 0;
    for (const button of document.querySelectorAll("[data-needs-effects]")) button.disabled = added.length === 0;
    element("set-aside").hidden = aside === null;
    if (aside === null) return;
    fill(element("ladder-aside"), aside, false);
    const [own, other] = [added, aside].map((effects) => page.models[keyOf(effects)].test_rms);
    element("paths").textContent = `This path ends at ${digits(own)} ${page.unit}, the one set aside at ${digits(other)} ${page.unit}.`;
  }

  function say(text, bad) {
    element("message").textContent = text;
    element("message").className = bad ? "bad" : "";
    if (text !== "") element("message").scrollIntoView({ block: "nearest" });
  }

  // Shows a path; what was not fitted of it the server fits.
  function take(effects, isStep = true) {
    const missing = steps(effects).filter((step) => !known(step));
    if (missing.length > 0 && page.served) {
      ask({ action: "fit", effects }, `Fitting ${page.base} with ${readable(effects)}`);
      return;
    }
    if (!known(effects)) {
      const command = page.command + effects.map((name) => ` --add ${name}`).join("");
      say(`${readable(effects)} together were not fitted in this diagnosis. To fit them: ${command} --output out`);
      return;
    }
    if (isStep) past.push(added);
    added = effects;
    say(missing.length === 0 ? "" : `Not fitted in this diagnosis, so without a step: ${missing.map(readable).join("; ")}.`);
    show();
  }

  // The automatic path, step by step.
  function play(count = 0) {
    const path = steps(page.selected).filter(known);
    asked = true;
    if (keyOf(added) === keyOf(path[count]) && count > 0) show();
    else take(path[count]);
    if (count + 1 < path.length) {
      const pause = count === 0 ? 400 : window.matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 1200;
      playing = window.setTimeout(play, pause, count + 1);
    }
  }

  function move(action, effect) {
    const at = added.indexOf(effect);
    const effects = added.filter((name) => name !== effect);
    if (action !== "out") effects.splice(at + (action === "up" ? -1 : 1), 0, effect);
    take(effects);
    const again = document.querySelector(`#ladder [data-move=${action}][data-effect=${effect}]:not(:disabled)`);
    (again || element("message")).focus();
  }

  // One request at a time: what is clicked meanwhile is not done.
  function ask(content, words) {
    if (document.body.hasAttribute("aria-busy")) return;
    number += 1;
    since = performance.now();
    say(words + " …");
    element("progress").hidden = false;
    document.body.setAttribute("aria-busy", "true");
    named("request").data = { content: [JSON.stringify({ number, ...content })] };
  }

  function answered(text) {
    const answer = JSON.parse(text);
    for (const [key, model] of Object.entries(answer.models || {})) {
      if (key in page.models) continue;
      page.models[key] = model;
      [...element("other").children].find((item) => item.label === model.group).append(new Option(model.label, key));
    }
    if (answer.number !== number) return;
    document.body.removeAttribute("aria-busy");
    element("progress").hidden = true;
    if (answer.error && opening !== null) refused(answer.error);
    else if (answer.error) say(answer.error, true);
    else if (answer.models && opening !== null) open();
    else if (answer.models) {
      take(answer.effects);
      say(`Fitted in ${((performance.now() - since) / 1000).toFixed(1)} s.`);
    }
    if (answer.excitation) give(answer.excitation);
    if (answer.text !== undefined) say(answer.text);
  }

  function give({ text, name, file }) {
    say(`${text} The motion is in ${name}, with the other files that your browser keeps.`);
    hand(name, "text/csv", file);
  }

  function separate(key) {
    if (key in page.excitations) give(page.excitations[key]);
    else if (page.served) ask({ action: "separate", effects: page.models[key].effects }, "Looking for the excitation that tells most");
    else say('An excitation that tells this model from the selected one was not computed. "lumbar explore" computes it.', true);
  }

  function clicked(event) {
    const button = event.target.closest("button");
    if (button === null) return;
    window.clearTimeout(playing);
    const { add: name, ask: action, move: way, svg, separate: other, zoom: time } = button.dataset;
    if (name !== undefined) take([...added, name]);
    if (way !== undefined) move(way, button.dataset.effect);
    if (svg !== undefined) picture(svg);
    if (other !== undefined) separate(other || keyOf(added));
    if (time !== undefined) zoomed(time);
    if (action !== undefined) ask({ action, effects: added }, "Working");
    if (button.id === "best") play();
    if (button.id === "undo") take(past.pop(), false);
    if (button.id === "restart") take([]);
    if (button.id === "keep") { aside = added; show(); }
    if (button.id === "swap") { const other_path = aside; aside = added; take(other_path); }
    if (button.id === "forget") { aside = null; show(); }
    if (button.id === "table") table();
    if (button.id === "clear") { element("from").value = element("to").value = ""; brushTime(); }
  }

  // What is wider than the page can be scrolled from the keyboard.
  function reachable() {
    for (const box of document.querySelectorAll(".scroll, #again")) {
      if (box.scrollWidth > box.clientWidth || box.scrollHeight > box.clientHeight) box.tabIndex = 0;
      else box.removeAttribute("tabindex");
    }
  }

  function start() {
    const found = window.Bokeh && window.Bokeh.documents.find((item) => item.get_model_by_name("shown") !== null);
    if (!found) { window.setTimeout(start, 20); return; }
    pictures = found;
    document.addEventListener("click", clicked);
    for (const id of ["record", "other"]) element(id).addEventListener("change", show);
    for (const box of document.querySelectorAll("[data-curve]")) box.addEventListener("change", switched);
    for (const fold of document.querySelectorAll("details")) fold.addEventListener("toggle", reachable);
    for (const id of ["from", "to"]) element(id).addEventListener("change", brushTime);
    window.addEventListener("hashchange", reopened);
    window.addEventListener("resize", reachable);
    window.lumbarDark(pictures);
    // A finger scrolls the page: it neither marks samples nor moves the time.
    if (window.matchMedia("(pointer: coarse)").matches) for (const { toolbar } of pictures.roots()) toolbar.active_drag = null;
    show();
    reopened();
    document.body.dataset.ready = "yes";
  }

  start();
  return { brush, brushBand, moved, answered, whole: () => whole };
})();
