// Where the model fails: its error in the motion, over depth, around reversals; and what is marked in all pictures.
"use strict";
window.lumbarWhere = (shown, named, put, digits, page) => {
  const CELLS = 24;
  const FEWEST = 5; // samples that make a mean

  function span(values) {
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    const step = (high - low) / CELLS || 1;
    return { low, step, cell: (value) => Math.min(CELLS - 1, Math.floor((value - low) / step)) };
  }

  // Means of values over groups of samples; group(i) is undefined where a sample belongs to none.
  function means(values, count, group) {
    const [sums, numbers] = [new Float64Array(count), new Float64Array(count)];
    for (let i = 0; i < values.length; i++) {
      const own = group(i);
      if (own !== undefined) { sums[own] += values[i]; numbers[own] += 1; }
    }
    return Array.from(sums, (sum, own) => (numbers[own] >= FEWEST ? sum / numbers[own] : NaN));
  }

  // Root mean square error in cells of position and velocity.
  function plane() {
    const { position, velocity, model_error: error } = shown();
    const [x, y] = [span(position), span(velocity)];
    const [sums, numbers] = [new Float64Array(CELLS * CELLS), new Float64Array(CELLS * CELLS)];
    for (let i = 0; i < error.length; i++) {
      const cell = y.cell(velocity[i]) * CELLS + x.cell(position[i]);
      sums[cell] += error[i] * error[i];
      numbers[cell] += 1;
    }
    const cells = { position: [], velocity: [], width: [], height: [], rms: [] };
    numbers.forEach((number, cell) => {
      if (number === 0) return;
      cells.position.push(x.low + ((cell % CELLS) + 0.5) * x.step);
      cells.velocity.push(y.low + (Math.floor(cell / CELLS) + 0.5) * y.step);
      cells.width.push(x.step);
      cells.height.push(y.step);
      cells.rms.push(Math.sqrt(sums[cell] / number));
    });
    put("cells", cells);
    named("shading").high = Math.max(...cells.rms, 1e-12);
  }

  function depth() {
    const { position, velocity, model_error: model, other_error: other } = shown();
    const x = span(position);
    const along = (sign) => (i) => (sign * velocity[i] > 0 ? x.cell(position[i]) : undefined);
    put("depth means", {
      position: Array.from({ length: CELLS }, (_, cell) => x.low + (cell + 0.5) * x.step),
      model_advancing: means(model, CELLS, along(1)), model_retracting: means(model, CELLS, along(-1)),
      other_advancing: means(other, CELLS, along(1)), other_retracting: means(other, CELLS, along(-1)),
    });
  }

  function turns() {
    const { time, since, model_turned: model, other_turned: other } = shown();
    let reach = 0;
    for (const value of since) if (Math.abs(value) > reach) reach = Math.abs(value);
    const step = Math.max(time[1] - time[0], reach / CELLS);
    const half = Math.round(reach / step);
    const group = (i) => (Number.isNaN(since[i]) ? undefined : Math.round(since[i] / step) + half);
    const count = reach > 0 ? 2 * half + 1 : 0;
    put("turn means", {
      since: Array.from({ length: count }, (_, bin) => (bin - half) * step),
      model: means(model, count, group), other: means(other, count, group),
    });
  }

  // Real and imaginary part of a Fourier sum at a frequency; its pointer turns from sample to sample.
  function sum(values, frequency) {
    const { time } = shown();
    const angle = -2 * Math.PI * frequency * (time[1] - time[0]);
    const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
    let [x, y, real, imaginary] = [1, 0, 0, 0];
    for (const value of values) {
      real += value * x;
      imaginary += value * y;
      [x, y] = [x * cosine - y * sine, x * sine + y * cosine];
    }
    return [real, imaginary];
  }

  // What of the model's error lies in a band of frequencies.
  function inBand(low, high) {
    const { time, model_error: error } = shown();
    const [length, step] = [error.length, time[1] - time[0]];
    const part = new Float64Array(length);
    for (let k = Math.max(1, Math.ceil(low * length * step)); k <= Math.min(high * length * step, length / 2); k++) {
      const [real, imaginary] = sum(error, k / (length * step));
      const weight = (2 * k === length ? 1 : 2) / length;
      for (let i = 0; i < length; i++) {
        const angle = (2 * Math.PI * ((k * i) % length)) / length;
        part[i] += weight * (real * Math.cos(angle) - imaginary * Math.sin(angle));
      }
    }
    return part;
  }

  // Amplitude density of the error in the samples that are marked, at the spectrum's lines: a mean over the band of each.
  function density(inside) {
    const { time, model_error: error } = shown();
    const step = time[1] - time[0];
    const values = new Float64Array(error.length);
    for (const i of inside) values[i] = error[i];
    const lines = Array.from(named("lines").data.frequency).filter((line) => line <= 0.5 / step);
    const width = lines[1] - lines[0];
    const parts = Math.max(1, Math.round(width * step * error.length)); // sums in a band
    const found = lines.map((line) => {
      let power = 0;
      for (let k = 0; k < parts; k++) power += Math.hypot(...sum(values, line + ((k + 0.5) / parts - 0.5) * width)) ** 2;
      return Math.sqrt((2 * step * power) / (parts * inside.length));
    });
    return { frequency: lines, density: found };
  }

  function mark(inside, lines) {
    const data = shown();
    put("brushed", Object.fromEntries(Object.keys(data).map((name) => [name, inside.map((i) => data[name][i])])));
    put("brushed lines", inside.length === 0 ? { frequency: [], density: [] } : lines || density(inside));
    const rms = (name) => Math.sqrt(inside.reduce((sum, i) => sum + data[name][i] ** 2, 0) / inside.length);
    return inside.length === 0
      ? "Draw a box in a picture to mark the same samples in all of them."
      : `${inside.length} samples marked: error ${digits(rms("model_error"))} ${page.unit} RMS` +
        `${Number.isFinite(shown().other[0]) ? `, ${digits(rms("other_error"))} ${page.unit} with the compared model` : ""}.`;
  }

  function samples(belongs) {
    const inside = [];
    for (let i = 0; i < shown().time.length; i++) if (belongs(i)) inside.push(i);
    return inside;
  }

  function box(across, up, { x0, x1, y0, y1 }) {
    const { [across]: x, [up]: y } = shown();
    return mark(samples((i) => x[i] >= x0 && x[i] <= x1 && y[i] >= y0 && y[i] <= y1));
  }

  // Of a band of frequencies those samples are marked in which the error in it is larger than its root mean square.
  function band({ x0, x1 }) {
    const part = inBand(x0, x1);
    const { model_error: error } = shown();
    const square = (values) => values.reduce((sum, value) => sum + value * value, 0);
    const level = Math.sqrt(square(part) / part.length);
    const { frequency, model } = named("lines").data;
    const inside = Array.from(frequency.keys()).filter((i) => frequency[i] >= x0 && frequency[i] <= x1);
    const lines = { frequency: inside.map((i) => frequency[i]), density: inside.map((i) => model[i]) };
    const share = digits((100 * square(part)) / square(error));
    return `${digits(x0)} to ${digits(x1)} Hz hold ${share} % of the model's error. Where it is largest: ` +
      mark(samples((i) => Math.abs(part[i]) > level), lines);
  }

  const draw = () => { plane(); depth(); turns(); };
  const between = (low, high) => mark(samples((i) => shown().time[i] >= low && shown().time[i] <= high));
  return { draw, box, band, between, nothing: () => mark([]) };
};
