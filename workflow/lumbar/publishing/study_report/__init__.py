"""The report of a study: one page with all that it made, in the thesis's order."""
