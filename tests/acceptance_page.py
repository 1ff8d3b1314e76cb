"""The page of the documentation that the acceptance suites write their tables to."""

import re
from collections.abc import Sequence
from pathlib import Path

from lumbar.base.files import write_text


def write_section(page: Path, name: str, lines: Sequence[str]) -> None:
    """Replace what stands between ``<!-- NAME -->`` and ``<!-- end of NAME -->``."""
    start, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    text = page.read_text(encoding="utf-8")
    pattern = re.compile(f"{re.escape(start)}.*{re.escape(end)}", re.DOTALL)
    if not pattern.search(text):
        raise ValueError(f"{page}: no section from {start} to {end}")
    body = "\n".join([start, "", *lines, "", end])
    write_text(page, pattern.sub(lambda _: body, text))


def show_section(page: Path | None, name: str, lines: Sequence[str]) -> None:
    """Print a section, and where there is a page for it, renew it there."""
    print("\n".join(lines))
    if page:
        write_section(page, name, lines)
