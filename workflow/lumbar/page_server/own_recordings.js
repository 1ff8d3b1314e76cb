// Sends files and choices to the server and shows what it answers; whatever a file says is shown as text.
"use strict";
(() => {
  const element = (id) => document.getElementById(id);
  const { tab, most } = document.body.dataset;
  const TEXTS = ["time", "time_unit", "position", "position_unit", "force", "force_unit", "rate", "table", "encoding"];
  const SWITCHES = ["flip_force", "accept_clipped"];
  let asked = 0;
  let unseen = new Set(); // records that a person took out of the training
  let trained = new Set(); // and those that they put in

  function made(tag, text, more = {}) {
    const item = document.createElement(tag);
    if (text !== undefined) item.textContent = text;
    return Object.assign(item, more);
  }

  async function ask(address, body) {
    const answer = await fetch(address, { method: "POST", headers: { "X-Lumbar-Tab": tab }, body }).catch(() => null);
    if (answer === null) throw new Error("The server does not answer, or refused the file: is 'lumbar explore' still running?");
    const content = await answer.json().catch(() => ({ error: `The server answered ${answer.status}.` }));
    if (content.error) throw new Error(content.error);
    return content;
  }

  function say(id, text, bad = false) {
    element(id).textContent = text;
    element(id).className = bad ? "bad" : "";
  }

  function choices() {
    const chosen = { trim: [element("trim_from").value, element("trim_to").value] };
    for (const name of TEXTS) chosen[name] = element(name).value;
    for (const name of SWITCHES) chosen[name] = element(name).checked;
    return chosen;
  }

  async function give(files) {
    for (const file of files) {
      if (file.size > most) {
        say("message", `${file.name}: larger than ${most / 1e6} MB, the most that the page takes. Give a part, or use lumbar import.`, true);
        return;
      }
      say("message", `Reading ${file.name} …`);
      const ours = (asked += 1);
      try {
        show(await ask(`/_own/file?name=${encodeURIComponent(file.name)}`, file), ours);
        say("message", "");
      } catch (error) { say("message", error.message, true); return; }
    }
  }

  async function look(address = "/_own/look", more = { choices: choices() }) {
    const ours = (asked += 1);
    try { show(await ask(address, JSON.stringify(more)), ours); } catch (error) { say("message", error.message, true); }
  }

  function show(state, number) {
    if (number !== asked) return; // a later question is under way
    element("form").hidden = state.files.length === 0;
    if (element("listed")) element("listed").hidden = state.files.length > 0;
    element("files").replaceChildren(...state.files.map((file) => {
      const item = made("li", `${file.file} `);
      const button = made("button", "Take away", { type: "button" });
      button.setAttribute("aria-label", `Take ${file.file} away`);
      button.addEventListener("click", () => look("/_own/remove", { file: file.file }));
      item.append(button);
      return item;
    }));
    for (const role of ["time", "position", "force"]) columns(role, state);
    for (const [name, texts] of Object.entries(state.fields)) {
      element(`${name}-wrong`).textContent = texts.join("\n");
      const field = element(name) || element("trim_from");
      field.setAttribute("aria-invalid", String(texts.length > 0));
    }
    element("common").textContent = state.common;
    element("remark").textContent = state.files.map((file) => file.remark).find(Boolean) || "";
    element("previews").replaceChildren(...state.files.map(card));
    training(state.files.filter((file) => file.record));
    const sound = state.files.every((file) => file.record) && !state.common;
    element("start").disabled = element("save").disabled = !sound;
    if (!element("name").value && state.files.length > 0) {
      element("name").value = state.files[0].file.replace(/\..*$/, "").replace(/[^A-Za-z0-9_-]+/g, "_").replace(/^[_-]+/, "") || "own";
    }
  }

  function columns(role, state) {
    const select = element(role);
    const chosen = state.choices[role] || "";
    const found = state.files.find((file) => file.grounds);
    const [column, unit] = (found && found.found[role]) || [role === "time" && found ? "none: the rate is stated" : "not found", ""];
    const options = [new Option(`${column}${found ? " (found)" : ""}`, "")];
    element(`${role}_unit`).placeholder = unit ? `${unit} (found)` : "";
    if (role === "time") options.push(new Option("none: the rate is given", "none"));
    options.push(...state.columns.map((column) => new Option(`${column.label}: ${column.sample}`, column.value)));
    select.replaceChildren(...options);
    select.value = chosen;
    element(`${role}-why`).textContent = found ? found.grounds[role] : "";
  }

  function card(file) {
    const item = made("article", undefined, { className: "card" });
    item.append(made("h3", file.record ? `${file.record} (${file.file})` : file.file));
    for (const text of file.wrong) item.append(made("p", text, { className: "bad" }));
    if (!file.record) {
      const list = made("ul");
      list.append(...file.columns.map((column) => made("li", `${column.label}: ${column.sample}`)));
      item.append(list);
      return item;
    }
    for (const text of file.notes) item.append(made("p", text, { className: "note" }));
    for (const curve of file.curves) item.append(drawn(curve, file.seconds), made("p", `${curve.label} over ${file.seconds.toPrecision(4)} s`, { className: "note" }));
    const table = made("table");
    table.append(...file.header.map((name, at) => { // several axes have more columns than fit into a card
      const line = made("tr");
      line.append(made("th", name, { scope: "row" }), ...file.rows.map((cells) => made("td", cells[at])));
      return line;
    }));
    const scroll = made("div", undefined, { className: "scroll" });
    scroll.append(table);
    item.append(scroll, made("p", file.facts.slice(1).join("; "), { className: "note" }), made("p", file.form, { className: "note" }));
    return item;
  }

  function drawn(curve, seconds) {
    const SVG = "http://www.w3.org/2000/svg";
    const picture = document.createElementNS(SVG, "svg");
    picture.setAttribute("viewBox", "0 0 1 1");
    picture.setAttribute("preserveAspectRatio", "none");
    picture.setAttribute("role", "img");
    picture.setAttribute("aria-label", `${curve.label} over ${seconds.toPrecision(4)} s`);
    const line = document.createElementNS(SVG, "polyline");
    line.setAttribute("points", curve.points.map(([time, value]) => `${time},${1 - value}`).join(" "));
    picture.append(line);
    return picture;
  }

  function training(files) {
    const longest = files.reduce((best, file) => (best && best.seconds >= file.seconds ? best : file), null);
    element("training").replaceChildren(...files.map((file) => {
      const label = made("label", ` ${file.record}: training`);
      const box = made("input", undefined, { type: "checkbox", value: file.record });
      box.checked = trained.has(file.record) || (file === longest && !unseen.has(file.record));
      box.addEventListener("change", () => {
        (box.checked ? trained : unseen).add(file.record);
        (box.checked ? unseen : trained).delete(file.record);
      });
      label.prepend(box);
      return label;
    }));
  }

  const wanted = () => JSON.stringify({
    choices: choices(),
    name: element("name").value,
    train: [...element("training").querySelectorAll("input:checked")].map((box) => box.value),
  });

  async function begin(address, then) {
    say("outcome", "…");
    element("start").disabled = element("save").disabled = true; // one click is enough
    try { then(await ask(address, wanted())); } catch (error) { say("outcome", error.message, true); }
    element("start").disabled = element("save").disabled = false;
  }

  const drop = element("drop");
  element("choose").addEventListener("change", (event) => { give([...event.target.files]); event.target.value = ""; });
  for (const kind of ["dragover", "dragleave", "drop"]) {
    document.addEventListener(kind, (event) => {
      event.preventDefault(); // else the browser leaves the page for the file
      drop.classList.toggle("over", kind === "dragover");
      if (kind === "drop") give([...event.dataTransfer.files]);
    });
  }
  element("form").addEventListener("change", (event) => {
    if (event.target.id !== "name" && !event.target.closest("#training")) look();
  });
  element("form").addEventListener("submit", (event) => {
    event.preventDefault();
    begin("/_own/start", (answer) => { location.href = answer.address; });
  });
  element("save").addEventListener("click", () => begin("/_own/save", (answer) => say("outcome", answer.text)));

  function restored(state, number) {
    if (number !== asked) return; // files came first: what was typed since stays
    for (const name of TEXTS) if (state.choices[name] !== undefined && element(name).tagName === "INPUT") element(name).value = state.choices[name];
    for (const name of SWITCHES) element(name).checked = state.choices[name] === true;
    const [from, to] = state.choices.trim;
    element("trim_from").value = from ?? "";
    element("trim_to").value = to ?? "";
    show(state, number);
  }
  const first = (asked += 1);
  ask("/_own/look", "{}").then((state) => restored(state, first)).catch((error) => say("message", error.message, true));
})();
