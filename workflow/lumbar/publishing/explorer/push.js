// The handle: its position goes to every model as time passes, their forces to bars, loops and ears.
const push = JSON.parse(document.getElementById("page-data").textContent).push;
const SHOWN_S = 6, LOOKS = 250; // seconds of the loops that are drawn; positions in a second that are kept of them
const handle = document.getElementById("handle");
const canvas = document.getElementById("hand");
const rows = [...document.querySelectorAll("#push .forces li")];
const colour = (name, of = canvas) => getComputedStyle(of).getPropertyValue(name).trim();
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
let [models, sound, frequency, begun, last, largest, drawn] = [[], null, 0, 0, null, 0, []];

// Where the hand is: on the handle, or where it is moved to and fro.
function position(time) {
  if (!frequency) return Number(handle.value);
  const [middle, reach] = [(push.lowest + push.highest) / 2, 0.4 * (push.highest - push.lowest)];
  const phase = 2 * Math.PI * frequency * (time - begun);
  return middle + (push.rest - middle) * Math.exp(-(time - begun)) * Math.cos(phase) + reach * Math.sin(phase) * (1 - Math.exp(-(time - begun)));
}

function rest() {
  for (const model of models) model.reset();
  [last, drawn] = [null, []];
}

// Bars and axes begin with what a slow way through the range asks for: at rest they would show rounding in full size.
function scale() {
  for (let look = 0; look <= LOOKS; look++) {
    const at = push.lowest + (push.highest - push.lowest) * (look / LOOKS);
    largest = Math.max(largest, ...models.map((model) => Math.abs(model.step(look / LOOKS, at))));
  }
  rest();
}

function tick(milliseconds) {
  requestAnimationFrame(tick);
  const time = milliseconds / 1000;
  if (last && time - last.time > 0.2) rest(); // the page was out of sight
  const now = { time, position: position(time) };
  if (frequency) handle.value = now.position;
  const from = last ?? now;
  const looks = Math.max(1, Math.round(LOOKS * (now.time - from.time)));
  for (let look = 1; look <= looks; look++) {
    const share = look / looks;
    const instant = from.time + share * (now.time - from.time);
    const at = [instant, frequency ? position(instant) : from.position + share * (now.position - from.position)];
    const forces = models.map((model) => model.step(...at));
    drawn.push({ time: at[0], position: at[1], forces });
    largest = Math.max(largest, ...forces.map(Math.abs));
  }
  last = now;
  drawn = drawn.filter((item) => item.time > time - SHOWN_S);
  show(drawn.at(-1).forces);
}

function show(forces) {
  const values = forces.length > 1 ? [...forces, forces[1] - forces[0]] : forces;
  values.forEach((force, which) => {
    const share = largest ? force / largest : 0;
    const bar = rows[which].querySelector(".bar");
    bar.style.left = `${50 + Math.min(0, 50 * share)}%`;
    bar.style.width = `${50 * Math.abs(share)}%`;
    rows[which].querySelector(".force").textContent = `${force.toFixed(3).replace("-", "−")} ${push.unit}`;
    if (sound?.[which]) sound[which].frequency.value = 110 * 4 ** Math.abs(share);
  });
  drawLoops();
}

function drawLoops() {
  const [width, height, dense] = [canvas.clientWidth, canvas.clientHeight, window.devicePixelRatio || 1];
  if (canvas.width !== Math.round(width * dense)) [canvas.width, canvas.height] = [Math.round(width * dense), Math.round(height * dense)];
  const pen = canvas.getContext("2d");
  pen.setTransform(dense, 0, 0, dense, 0, 0);
  pen.clearRect(0, 0, width, height);
  const [left, low, top] = [60, height - 36, 12];
  const x = (value) => left + ((value - push.lowest) / (push.highest - push.lowest)) * (width - left - 12);
  const y = (value) => (low + top) / 2 - (value / (1.1 * largest || 1)) * ((low - top) / 2);
  pen.strokeStyle = pen.fillStyle = colour("--quiet");
  pen.font = `12px ${getComputedStyle(canvas).fontFamily}`;
  pen.lineWidth = 1;
  pen.strokeRect(left, top, width - left - 12, low - top);
  pen.textAlign = "right";
  for (const share of [-1, 0, 1]) pen.fillText((share * largest).toPrecision(3).replace("-", "−"), left - 5, y(share * largest) + 4);
  pen.textAlign = "center";
  for (const value of [push.lowest, (push.lowest + push.highest) / 2, push.highest]) {
    pen.fillText(Number(value.toPrecision(3)).toString().replace("-", "−"), Math.min(width - 26, x(value)), low + 15);
  }
  pen.fillText(push.moved, (left + width) / 2, height - 4);
  pen.save();
  pen.translate(12, (low + top) / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText(push.answer, 0, 0);
  pen.restore();
  models.forEach((_, which) => {
    pen.beginPath();
    pen.strokeStyle = colour("--hue", rows[which]);
    pen.lineWidth = 2;
    pen.setLineDash(which ? [7, 4] : []);
    for (const item of drawn) pen.lineTo(x(item.position), y(item.forces[which]));
    pen.stroke();
  });
  pen.setLineDash([]);
}

// One tone per model, the first in the left ear.
function tones() {
  const context = new AudioContext();
  return models.map((_, which) => {
    const [tone, ear, quiet] = [context.createOscillator(), context.createStereoPanner(), context.createGain()];
    ear.pan.value = models.length > 1 ? 2 * which - 1 : 0;
    quiet.gain.value = 0.05;
    tone.connect(quiet).connect(ear).connect(context.destination);
    tone.start();
    return tone;
  });
}

function listen(event) {
  for (const tone of sound ?? []) tone.stop();
  sound = event.target.checked ? tones() : null;
}

function moving(hertz) {
  rest();
  [frequency, begun] = [hertz, performance.now() / 1000];
  if (!hertz) handle.value = push.rest;
}

async function begin() {
  models = await Promise.all(push.models.map((model) => TissueForce.open(bytes(model.library), model.description)));
  handle.addEventListener("input", () => { frequency = 0; });
  for (const button of document.querySelectorAll("#push [data-swing]")) {
    button.addEventListener("click", () => moving(Number(button.dataset.swing)));
  }
  document.getElementById("let-go").addEventListener("click", () => moving(0));
  document.getElementById("hear").addEventListener("change", listen);
  scale();
  requestAnimationFrame(tick);
}

if (push?.models.length) {
  begin().catch((error) => {
    document.getElementById("push-trouble").textContent = `This browser cannot play the models: ${error.message}`;
  });
}
