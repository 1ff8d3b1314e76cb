"""Whether a page can be used by everybody and at every width, as far as a program can tell."""

from pathlib import Path

import pytest

WIDTHS = (1440, 1024, 768, 390)
_FAULTS = Path(__file__).with_name("page_faults.js").read_text(encoding="utf-8")
"""Script that lists elements wider than the page, cut off, or covered although they can be clicked."""


def serious(page) -> list[tuple[str, str]]:
    """Return the serious and critical violations of axe-core, with the element."""
    reason = "the dependency group 'dev' has it"
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason=reason).Axe()
    violations = axe.run(page).response["violations"]
    return [
        (item["id"], item["nodes"][0]["html"])
        for item in violations
        if item["impact"] in ("serious", "critical")
    ]


def fits(page, *widths: int) -> None:
    """Nothing is wider than the page, cut off or covered, at each width: pictures follow its size a moment later."""
    for width in widths:
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_function("width => document.documentElement.scrollWidth <= width", arg=width)
        for _ in range(10):
            if not (faults := page.evaluate(_FAULTS)):
                break
            page.wait_for_timeout(500)
        assert faults == [], width
