"""Whether a page can be used by everybody, as far as a program can tell."""

import pytest


def serious(page) -> list[tuple[str, str]]:
    """What axe-core finds serious or critical, with the element."""
    reason = "the dependency group 'dev' has it"
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason=reason).Axe()
    found = axe.run(page).response["violations"]
    return [
        (item["id"], item["nodes"][0]["html"]) for item in found if item["impact"] in ("serious", "critical")
    ]


def fits(page, *widths: int) -> None:
    """Wait until nothing is wider than the page, at each width: pictures follow its size a moment later."""
    for width in widths:
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_function("width => document.documentElement.scrollWidth <= width", arg=width)
