"""Tables as they are published: layout, words, CSV, LaTeX and HTML."""
