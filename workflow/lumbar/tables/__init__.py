"""Published tables: layout, text, CSV, LaTeX and HTML."""
