"""A real browser for pages, and what goes wrong in them."""

import os
import shutil

import pytest

from patience import PATIENCE_S

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRAWN = "() => (window.Bokeh?.documents ?? []).every((item) => item.is_idle)"
"""True if every picture has its final position: a pointer that is moved earlier misses it."""


@pytest.fixture(scope="session")
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium here: install it (Debian: apt-get install chromium)")
    sync_playwright = pytest.importorskip(
        "playwright.sync_api", reason="the dependency group 'dev' has it"
    ).sync_playwright
    with sync_playwright() as driver:
        # Root may start a browser only without its sandbox, as in most containers; the pages are our own.
        started = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox"] if os.getuid() == 0 else []
        )
        yield started
        started.close()


@pytest.fixture
def new_page(browser):
    """Return a function that opens an address and collects what goes wrong in the page."""
    opened = []

    def open_page(address: str, ready: str = "body[data-ready=yes]", **options):
        page = browser.new_page(**options)
        page.set_default_timeout(1000 * PATIENCE_S)
        page.wrong, page.asked = [], []
        page.on("pageerror", lambda error: page.wrong.append(str(error)))
        page.on("dialog", lambda dialog: (page.wrong.append(dialog.message), dialog.dismiss()))
        page.on("request", lambda request: page.asked.append(request.url))
        page.goto(address)
        page.wait_for_selector(ready)
        page.drawn = lambda: page.wait_for_function(DRAWN)
        page.drawn()
        opened.append(page)
        return page

    yield open_page
    for page in opened:
        assert page.wrong == []
        page.close()
