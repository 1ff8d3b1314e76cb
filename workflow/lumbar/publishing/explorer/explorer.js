// What the page does by itself: shows another record or model, adds what was fitted already, hands out files.
// Where it is served, it asks the server for what was not computed.
"use strict";
window.lumbar = (() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const element = (id) => document.getElementById(id);
  let pictures; // Bokeh's document
  let added = page.selected.slice();
  let aside = null; // a path that was set aside, to be compared
  const past = [];
  let underway = ""; // what was asked last
  let next = null; // and what comes after it
  let asked = 0;
  let locating = null; // model of which the server is to say where it fails
  let since; // when the server was asked
  let windowed; // record of which the beginning was shown already
  let opening = null; // what the address asks for, while the server fits it
  let session; // the address that was written last
  const initial = {}; // what is shown where the address says nothing

  const named = (name) => pictures.get_model_by_name(name);
  const keyOf = (effects) => effects.slice().sort().join("+") || "base";
  const readable = (effects) => effects.map((name) => name.replaceAll("_", " ")).join(" and ") || "no effect";
  const digits = (value) => (value === null ? "unknown" : Number(value).toPrecision(3));
  const known = (effects) => keyOf(effects) in page.models;
  const steps = (effects) => [[], ...effects.map((_, i) => effects.slice(0, i + 1))];
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

  function show() {
    const record = element("record").value;
    const first = element("first").value;
    const second = element("second").value;
    const data = named("record:" + record).data;
    const less = (key) => Float32Array.from(data.measured, (value, i) => value - data[key][i]);
    const [first_error, second_error] = [less(first), less(second)];
    const turned = (error) => error.map((value, i) => value * data.turned[i]);
    whole = {
      time: data.time, position: data.position, velocity: data.velocity, since: data.since, measured: data.measured,
      first: data[first], second: data[second], first_error, second_error, ...setAsideViews(data),
      first_turned: turned(first_error), second_turned: turned(second_error),
    };
    const { frequency, noise, marker, ...lines } = named("spectrum:" + record).data;
    put("lines", { frequency, noise, marker, first: lines[first], second: lines[second], aside: aside === null ? frequency.map(() => NaN) : lines[keyOf(aside)] });
    const duration = data.time[data.time.length - 1];
    if (record !== windowed) {
      const end = Math.min(duration, page.window_s);
      named("course").x_range.setv({ start: 0, end, reset_start: 0, reset_end: duration });
      element("to").max = element("from").max = duration.toFixed(3);
    }
    windowed = record;
    inWindow();
    where.draw();
    element("region").textContent = where.nothing();
    merits(record, [first, second]);
    told(first, record);
    remember();
  }

  // The path that was set aside, with the chosen models.
  function setAsideViews(data) {
    const nothing = aside === null;
    const output = nothing ? data.measured.map(() => NaN) : data[keyOf(aside)];
    return { aside: output, aside_error: data.measured.map((value, i) => value - output[i]) };
  }

  function switched({ target: { dataset, checked } }) {
    for (const { renderers } of pictures.roots())
      for (const item of renderers) if (item.name === dataset.curve) item.setv({ visible: checked }, { sync: false });
  }

  // The address contains the state of the page: a reload, a bookmark or a link restores it.
  function remember() {
    const chosen = {
      path: added.join("+") || "base", aside: aside === null ? "" : aside.join("+") || "base",
      record: element("record").value, first: element("first").value, second: element("second").value,
    };
    if (initial.record === undefined) Object.assign(initial, chosen);
    if (opening !== null) return; // not there yet
    const changed = Object.entries(chosen).filter(([name, value]) => value !== (name === "second" ? keyOf(added) : initial[name]));
    const text = changed.map(([name, value]) => `${name}=${encodeURIComponent(value).replaceAll("%2B", "+")}`).join("&");
    if (session === undefined && text === "") return;
    session = text === "" ? "" : `#${text}`;
    try { history.replaceState(null, "", session || "#"); } catch { /* a frame whose address is not its own */ }
    if (window.parent !== window) window.parent.postMessage({ lumbar: session }, "*");
  }

  // Reads the address; a link within the page is followed, and the address then is what it was.
  function reopened() {
    if (!location.hash.includes("=")) {
      if (session) history.replaceState(null, "", session);
      return;
    }
    if (location.hash === session) return;
    try {
      const asked = location.hash.slice(1).split("&").map((part) => {
        const [name, value] = [part.split("=", 1)[0], decodeURIComponent(part.slice(part.indexOf("=") + 1))];
        if (!(name in initial)) throw new Error(`it knows no “${name}”; there are ${Object.keys(initial).join(", ")}`);
        return [name, value];
      });
      opening = { ...Object.fromEntries(asked) };
      for (const name of ["path", "aside"]) if (name in opening) opening[name] = opening[name] === "base" ? [] : opening[name].split("+");
      open();
    } catch (error) { refused(error.message); }
  }

  function refused(words) {
    opening = null;
    say(`The address cannot be followed: ${words}. What is shown is what could be.`, true);
  }

  // Shows what the address asks for, after the server fitted what is not there.
  function open() {
    for (const effects of [opening.path, opening.aside]) {
      if (effects === undefined || (page.served ? steps(effects) : [effects]).every(known)) continue;
      if (new Set(effects).size < effects.length) { refused(`${readable(effects)} names an effect twice`); return; }
      if (!page.served) { refused(`this diagnosis did not fit ${readable(effects)}; "lumbar explore" fits effects of the catalogue`); return; }
      ask({ action: "fit", effects }, `Fitting ${page.base} with ${readable(effects)}, as the address asks`);
      return;
    }
    const { path = page.selected, aside: other, ...chosen } = opening;
    for (const [name, value] of Object.entries(chosen)) {
      if ([...element(name).options].some((option) => option.value === value)) continue;
      refused(`there is no ${name === "record" ? "record" : "model"} “${value}”`);
      return;
    }
    opening = null;
    aside = other === undefined ? null : other;
    take(path, false);
    for (const [name, value] of Object.entries(chosen)) element(name).value = value;
    ladder();
    show();
  }

  // Lines and loops are drawn of the time that is shown alone: a long record would take a second.
  function inWindow() {
    const { start, end } = named("course").x_range;
    const [first, last] = [start, end].map((time) => whole.time.findIndex((value) => value >= time));
    const until = last < 0 ? whole.time.length : last + 1;
    const part = ([name, values]) => [name, values.slice(Math.max(first - 1, 0), until)];
    put("shown", Object.fromEntries(Object.entries(whole).map(part)));
  }

  // Once a frame, however often the range changes.
  let waits = false;
  function moved() {
    if (waits) return;
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

  function clearMark() {
    element("from").value = element("to").value = "";
    element("region").textContent = where.nothing();
  }

  const unseen = (record) => (page.trained.includes(record) ? "training" : "unseen");
  const ofNoise = (rms) => (page.noise_rms === null ? "unknown" : digits(rms / page.noise_rms));
  const merit = ({ rms, vaf, fit }) => [digits(rms), ofNoise(rms), vaf.toPrecision(5), digits(fit)];
  const MERITS = [`RMS error (${page.unit})`, "× noise", "VAF (%)", "FIT (%)"];

  // Both models on every record, the one that is shown in bold.
  function merits(shown, keys) {
    const head = made("thead", "");
    const above = made("tr", "");
    above.append(made("td", ""), made("td", ""));
    for (const key of keys) above.append(made("th", page.models[key].label, { colspan: MERITS.length, scope: "colgroup" }));
    head.append(above, row(["record", "part", ...MERITS, ...MERITS], "th", { scope: "col" }));
    const body = made("tbody", "");
    for (const record of Object.keys(page.models.base.merits)) {
      const line = row([unseen(record), ...keys.flatMap((key) => merit(page.models[key].merits[record]))], "td");
      line.prepend(made("th", record, { scope: "row" }));
      if (record === shown) line.setAttribute("aria-current", "true");
      body.append(line);
    }
    element("merits").replaceChildren(head, body);
  }

  function row(cells, tag, attributes) {
    const line = made("tr", "");
    line.append(...cells.map((text) => made(tag, text, attributes)));
    return line;
  }

  // Every model on every record, as a file.
  function table() {
    const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const lines = [["model", "group", "record", "part", `rms_${page.unit}`, "rms_of_noise", "vaf_percent", "fit_percent"]];
    for (const { label, group, effects, merits: all } of Object.values(page.models)) {
      const name = group === page.models.base.group ? [page.base, ...effects].join("+") : label;
      for (const [record, { rms, vaf, fit }] of Object.entries(all)) {
        const noise = page.noise_rms === null ? "" : rms / page.noise_rms;
        lines.push([name, group, record, unseen(record), rms, noise, vaf, fit]);
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

  // What locate says of the first model on this record, each sentence under the picture it speaks of.
  function told(key, record) {
    const found = page.models[key].located[record];
    const inPrint = (text) => text.replace(/(?<![\w.)])-(?=\d)/g, "−");
    const views = Object.fromEntries(Object.entries(found?.views ?? {}).map(([name, text]) => [name, inPrint(text)]));
    for (const place of document.querySelectorAll("[data-view]")) {
      place.textContent = views[place.dataset.view] || "";
      delete views[place.dataset.view];
    }
    const open = !found && page.served && page.models[key].group === page.models.base.group;
    element("headline").textContent = found ? inPrint(found.headline)
      : open ? "Looking where this model fails …"
      : "Where this model fails was not put into words: the pictures show it.";
    element("set-aside-views").replaceChildren(...Object.values(views).map((text) => made("li", text)));
    if (open && next === null && ask({ action: "locate", effects: page.models[key].effects }, "Looking where it fails", false)) locating = key;
  }

  function rung(effects, before, top, number) {
    const { train_rms, test_rms } = page.models[keyOf(effects)];
    const item = made("li", "");
    const line = made("div", "", { class: "rung" });
    const name = before === null ? page.base : "+ " + readable(effects.slice(before.length));
    const noise = page.noise_rms === null ? "" : `, ${ofNoise(test_rms)} × noise`;
    line.append(made("span", `${name}: ${digits(test_rms)} ${page.unit} on ${page.test_data} (${digits(train_rms)} in training${noise})`));
    if (number !== undefined) {
      const tools = made("span", "", { class: "tools" });
      const effect = effects[effects.length - 1];
      for (const [action, sign, words] of [["up", "↑", "earlier"], ["down", "↓", "later"], ["out", "✕", "out"]]) {
        const button = made("button", sign, { "data-move": action, "data-effect": effect, "aria-label": `${readable([effect])} ${words}` });
        button.disabled = (action === "up" && number === 1) || (action === "down" && number === added.length);
        tools.append(button);
      }
      line.append(tools);
    }
    const bar = made("span", "", { class: "bar" });
    bar.style.width = `${Math.min(100, (100 * test_rms) / top)}%`;
    const track = made("span", "", { class: "track" });
    track.append(bar);
    item.append(line, track);
    return item;
  }

  function fill(list, effects, movable) {
    const top = page.models.base.test_rms;
    const rungs = steps(effects).filter(known);
    const items = rungs.map((step, i) => rung(step, i === 0 ? null : rungs[i - 1], top, movable && i > 0 ? step.length : undefined));
    list.replaceChildren(...items);
    const noise = page.noise_rms;
    if (noise !== null) list.style.setProperty("--noise", `${Math.min(100, (100 * noise) / top)}%`);
  }

  function ladder() {
    fill(element("ladder"), added, true);
    element("undo").disabled = past.length === 0;
    element("remove").disabled = added.length === 0;
    for (const button of document.querySelectorAll("[data-needs-effects]")) button.disabled = added.length === 0;
    element("set-aside").hidden = element("aside-curve").hidden = aside === null;
    if (aside === null) return;
    fill(element("ladder-aside"), aside, false);
    const [own, other] = [added, aside].map((effects) => page.models[keyOf(effects)].test_rms);
    element("paths").textContent = `This path ends at ${digits(own)} ${page.unit} with ${count(added)}, the one set aside at ` +
      `${digits(other)} ${page.unit} with ${count(aside)}.`;
  }

  const count = (effects) => `${effects.length} effect${effects.length === 1 ? "" : "s"}`;

  function say(text, bad) {
    element("message").textContent = text;
    element("message").className = bad ? "bad" : "";
  }

  // Shows a path down the ladder; what was not fitted of it the server fits.
  function take(effects, remember = true) {
    const missing = steps(effects).filter((step) => !known(step));
    if (missing.length > 0 && page.served) {
      ask({ action: "fit", effects }, `Fitting ${page.base} with ${readable(effects)}`);
      return;
    }
    if (!known(effects)) {
      say(`${readable(effects)} together were not fitted in this diagnosis. "lumbar explore" fits them.`, true);
      return;
    }
    if (remember) past.push(added);
    added = effects;
    const { label, test_rms } = page.models[keyOf(effects)];
    const left = missing.length === 0 ? "" : ` Not fitted in this diagnosis, so without a step: ${missing.map(readable).join("; ")}.`;
    say(`${label}: error on ${page.test_data} ${digits(test_rms)} ${page.unit}.${left}`);
    element("second").value = keyOf(effects);
    ladder();
    show();
  }

  function move(action, effect) {
    const at = added.indexOf(effect);
    const effects = added.filter((name) => name !== effect);
    if (action !== "out") effects.splice(at + (action === "up" ? -1 : 1), 0, effect);
    take(effects);
    const again = document.querySelector(`#ladder [data-move=${action}][data-effect=${effect}]:not(:disabled)`);
    (again || element("message")).focus();
  }

  // One thing after the other: what a person asks meanwhile comes next, a second click on the same button does not.
  function ask(content, words, waits = true) {
    if (document.body.hasAttribute("aria-busy")) {
      if (waits && JSON.stringify(content) !== underway) next = [content, words];
      return false;
    }
    asked += 1;
    underway = JSON.stringify(content);
    since = performance.now();
    say(words + " …");
    element("progress").hidden = false;
    document.body.setAttribute("aria-busy", "true");
    named("request").data = { content: [JSON.stringify({ number: asked, ...content })] };
    return true;
  }

  function answered(text) {
    taken(text);
    if (next === null || document.body.hasAttribute("aria-busy")) return;
    const wanted = next;
    next = null;
    ask(...wanted);
  }

  function taken(text) {
    const answer = JSON.parse(text);
    for (const [key, model] of Object.entries(answer.models || {})) {
      if (key in page.models) continue; // where it fails may be known already
      page.models[key] = model;
      offer(key);
    }
    if (answer.number !== asked) return;
    document.body.removeAttribute("aria-busy");
    element("progress").hidden = true;
    if (answer.error && opening !== null) refused(answer.error);
    else if (answer.error) say(answer.error, true);
    if (locating !== null) {
      const unknown = Object.keys(page.models.base.merits).map((record) => [record, { headline: answer.error, views: {} }]);
      page.models[locating].located = answer.located || Object.fromEntries(unknown);
      locating = null;
      if (!answer.error) say("");
    }
    if (answer.models && opening !== null) open();
    else if (answer.models) {
      take(answer.effects);
      element("message").textContent += ` Fitted in ${((performance.now() - since) / 1000).toFixed(1)} s.`;
    } else told(element("first").value, element("record").value);
    if (answer.error) return;
    if (answer.excitation) give(answer.excitation);
    if (answer.text !== undefined) say(answer.text);
  }

  function offer(key) {
    const { label, group } = page.models[key];
    for (const select of [element("first"), element("second")]) {
      if ([...select.options].some((option) => option.value === key)) continue;
      [...select.children].find((item) => item.label === group).append(new Option(label, key));
    }
  }

  function give({ text, name, file }) {
    say(`${text} The motion is in ${name}, with the other files that your browser keeps.`);
    hand(name, "text/csv", file);
  }

  function separate(key) {
    if (key in page.excitations) give(page.excitations[key]);
    else if (page.served) ask({ action: "separate", effects: page.models[key].effects }, "Looking for the excitation that tells most");
    else say('An excitation that tells this candidate from the selected one was not computed. "lumbar explore" computes it.', true);
  }

  function clicked(event) {
    const button = event.target.closest("button");
    if (button === null) return;
    const { show: shown, add, ask: action, move: way, svg, separate: other } = button.dataset;
    if (shown !== undefined) { element("second").value = shown; show(); element("compare").scrollIntoView(); }
    if (add !== undefined) {
      const more = JSON.parse(add).filter((name) => !added.includes(name));
      if (more.length === 0) say(`${readable(JSON.parse(add))}: in the model already.`);
      else take([...added, ...more]);
    }
    if (way !== undefined) move(way, button.dataset.effect);
    if (svg !== undefined) picture(svg);
    if (other !== undefined) separate(other);
    if (action !== undefined) ask({ action, effects: added }, "Working");
    if (button.id === "undo") take(past.pop(), false);
    if (button.id === "remove") take(added.slice(0, -1));
    if (button.id === "restart") take([]);
    if (button.id === "set-aside") { aside = added; ladder(); show(); }
    if (button.id === "swap") { const other_path = aside; aside = added; take(other_path); }
    if (button.id === "forget") { aside = null; ladder(); show(); }
    if (button.id === "table") table();
    if (button.id === "clear") clearMark();
  }

  // What is wider than the page can be scrolled from the keyboard.
  function reachable() {
    for (const box of document.querySelectorAll(".scroll, section > table")) {
      if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
      else box.removeAttribute("tabindex");
    }
  }

  function start() {
    const found = window.Bokeh && window.Bokeh.documents.find((item) => item.get_model_by_name("shown") !== null);
    if (!found) { window.setTimeout(start, 20); return; }
    pictures = found;
    document.addEventListener("click", clicked);
    for (const id of ["record", "first", "second"]) element(id).addEventListener("change", show);
    for (const box of document.querySelectorAll("[data-curve]")) box.addEventListener("change", switched);
    window.addEventListener("hashchange", reopened);
    for (const id of ["from", "to"]) element(id).addEventListener("change", brushTime);
    window.lumbarDark(pictures);
    // A finger that scrolls the page marks nothing: the tools stay at hand.
    if (window.matchMedia("(pointer: coarse)").matches) for (const name of page.pictures) named(name).toolbar.active_drag = null;
    window.addEventListener("resize", reachable);
    ladder();
    show();
    reachable();
    reopened();
    document.body.dataset.ready = "yes";
  }

  start();
  return { brush, brushBand, moved, answered, whole: () => whole };
})();
