"""Pages for people: sentences, tables and pictures in one HTML file that works offline."""
