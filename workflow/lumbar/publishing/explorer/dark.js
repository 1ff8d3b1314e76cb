// Axes, grids, labels and what is drawn in ink made light where the reader's device is dark.
"use strict";
window.lumbarDark = (pictures) => {
  if (!window.matchMedia("(prefers-color-scheme: dark)").matches) return;
  const [light, ink] = ["#e6e6e6", "#ffffff"];
  const drawn = (item) => /^(measured|ink)/.test(item.name || "");
  for (const picture of pictures.roots()) {
    for (const axis of [...picture.below, ...picture.left]) {
      axis.axis_label_text_color = axis.major_label_text_color = light;
      axis.axis_line_color = axis.major_tick_line_color = axis.minor_tick_line_color = light;
    }
    for (const item of picture.center) {
      if ("grid_line_color" in item) item.grid_line_color = "#444444";
      if (drawn(item) && "line_color" in item) item.line_color = ink;
      if (drawn(item) && "text_color" in item) item.text_color = ink;
    }
    for (const bar of picture.right) {
      bar.major_label_text_color = bar.title_text_color = light;
      bar.background_fill_alpha = 0;
    }
    for (const { glyph } of picture.renderers.filter(drawn)) {
      glyph.line_color = ink;
      if (glyph.fill_color !== undefined && glyph.fill_color.value !== null) glyph.fill_color = ink;
    }
  }
};
