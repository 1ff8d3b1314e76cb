// Axes, grids, labels and what is drawn in ink made light where the reader's device is dark, and dark colours lighter.
"use strict";
window.lumbarDark = (pictures) => {
  if (!window.matchMedia("(prefers-color-scheme: dark)").matches) return;
  const [light, ink] = ["#e6e6e6", "#ffffff"];
  const LIGHTER = { "#0072b2": "#3d9be0", "#777777": "#9a9a9a" };
  const drawn = (item) => /^(measured|ink)/.test(item.name || "");
  // The look is this page's alone: a server is not told of it, and would not listen.
  const look = (item, values) => item.setv(values, { sync: false });
  for (const picture of pictures.roots()) {
    for (const axis of [...picture.below, ...picture.left]) {
      look(axis, {
        axis_label_text_color: light, major_label_text_color: light,
        axis_line_color: light, major_tick_line_color: light, minor_tick_line_color: light,
      });
    }
    for (const item of picture.center) {
      if ("grid_line_color" in item) look(item, { grid_line_color: "#444444" });
      if (drawn(item) && "line_color" in item) look(item, { line_color: ink });
      if (drawn(item) && "text_color" in item) look(item, { text_color: ink });
    }
    for (const bar of picture.right) {
      look(bar, { major_label_text_color: light, title_text_color: light, background_fill_alpha: 0 });
    }
    for (const renderer of picture.renderers) {
      const { glyph } = renderer;
      for (const name of ["line_color", "fill_color"]) {
        const value = glyph[name]?.value ?? null;
        if (value === null) continue;
        const other = drawn(renderer) ? ink : LIGHTER[String(value).toLowerCase()];
        if (other !== undefined) look(glyph, { [name]: other });
      }
    }
  }
  for (const key of document.querySelectorAll("[style*='--hue']")) {
    const other = LIGHTER[key.style.getPropertyValue("--hue").trim().toLowerCase()];
    if (other !== undefined) key.style.setProperty("--hue", other);
  }
};
