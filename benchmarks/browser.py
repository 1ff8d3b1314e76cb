"""The page of a diagnosis in a real browser: first picture, interactions on 12,000 samples, a refit, its size.

    python benchmarks/browser.py [--plotly plotly.min.js]

Prints what was measured beside what is aimed at; nothing is asserted, because machines differ. With Plotly's library at
hand the same four traces are drawn by it too, in the same browser, and the ratio is printed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

import lumbar
from lumbar.settings.twin import TwinSettings
from lumbar.twin.two_hidden_effects import TissueTestRanges, two_hidden_effects, write_records

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PERIODS = 12
"""Of 10 s at 100 Hz: 12,000 samples."""
REPEATS = 7
AIMS = {"first picture": 3.0, "interaction": 0.2, "refit": 2.0, "size": 8.0}
"""Seconds; of the size, MB."""
WAIT_MS = 300_000

UNTIL_DRAWN = """
const frame = () => new Promise((next) => requestAnimationFrame(next));
const drawn = async () => { await frame(); await frame(); await new Promise((next) => setTimeout(next)); await frame(); };
const timed = async (act) => { const begin = performance.now(); act(); await drawn(); return performance.now() - begin; };
"""
"""Bokeh and Plotly draw in the next frame or the one after it; a frame in which nothing is drawn costs what is printed too."""
ACTIONS = {
    "nothing": "() => {}",
    "zoom in": "() => named('course').x_range.setv({start: 20, end: 50})",
    "zoom out to all samples": "() => named('course').x_range.setv({start: 0, end: 120})",
    "another model": "() => choose('first')",
    "another record": "() => choose('record')",
    "a box over all pictures": "() => lumbar.brush('time', 'measured', {final: true, geometry: {type: 'rect', x0: 20,"
    " x1: 50, y0: -1e3, y1: 1e3}})",
    "a band of frequencies": "() => lumbar.brushBand({final: true, geometry: {type: 'rect', x0: 1, x1: 5, y0: 0, y1: 1e3}})",
}
OF_PAGE = """
const named = (name) => Bokeh.documents[0].get_model_by_name(name);
const choose = (id) => {
  const select = document.getElementById(id);
  select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
  select.dispatchEvent(new Event('change'));
};
"""


def row(what: str, seconds: float, aim: float | None = None, unit: str = "s") -> None:
    """Print one measurement."""
    told = "" if aim is None else f"  (aim {aim:g} {unit}: {'kept' if seconds <= aim else 'NOT KEPT'})"
    print(f"{what:58} {seconds:8.3f} {unit}{told}", flush=True)


def experiment(folder: Path) -> Path:
    """Write the records of an experiment with two hidden effects."""
    twin = TwinSettings()
    ranges = TissueTestRanges(periods=PERIODS)
    write_records(folder, two_hidden_effects(twin.two_hidden_effects, twin.seed, ranges))
    return folder


def opened(browser: Browser, address: str) -> Page:
    """Open a page and wait for its pictures."""
    page = browser.new_page(viewport={"width": 1280, "height": 1800})
    page.set_default_timeout(WAIT_MS)
    page.goto(address)
    page.wait_for_selector("body[data-ready=yes]")
    return page


def of_file(browser: Browser, records: Path, folder: Path) -> None:
    """The page as a file: size, first picture, interactions."""
    path = folder / "diagnosis.html"
    path.write_text(lumbar.diagnose(lumbar.read(records)).page().to_html(), encoding="utf-8")
    row("size of the page", path.stat().st_size / 1e6, AIMS["size"], "MB")
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        page = opened(browser, path.as_uri())
        times.append(time.perf_counter() - begin)
        if len(times) < 3:
            page.close()
    row("first picture of the file", min(times), AIMS["first picture"])
    samples = page.evaluate("lumbar.whole().time.length")
    for name, action in ACTIONS.items():
        script = f"async () => {{ {UNTIL_DRAWN} {OF_PAGE} return await timed({action}); }}"
        seconds = statistics.median(page.evaluate(script) for _ in range(REPEATS)) / 1000
        row(f"{name} ({samples} samples, 8 traces in 4 pictures)", seconds, AIMS["interaction"])
    page.close()


def beside_plotly(browser: Browser, library: Path) -> None:
    """Zoom of four traces of 12,000 samples, in Bokeh and in Plotly, alone on a page."""
    import numpy as np
    from bokeh.embed import file_html
    from bokeh.plotting import figure
    from bokeh.resources import INLINE

    across = np.arange(12_000) / 100
    ups = [np.sin(2 * np.pi * across * (1 + k / 10)) for k in range(4)]
    picture = figure(width=1200, height=400, name="peer")
    for up in ups:
        picture.line(across, up)
    traces = [{"x": across.tolist(), "y": up.tolist(), "mode": "lines", "type": "scatter"} for up in ups]
    plotly = (
        f"<meta charset='utf-8'><div id='plot'></div><script>{library.read_text(encoding='utf-8')}</script>"
        f"<script>Plotly.newPlot('plot', {traces}, {{width: 1200, height: 400}})"
        ".then(() => { document.body.dataset.ready = 'yes'; });</script>"
    )
    bokeh = file_html(picture, INLINE, "peer") + "<script>document.body.dataset.ready = 'yes';</script>"
    zooms = {
        "Bokeh": (
            bokeh,
            "Bokeh.documents[0].get_model_by_name('peer').x_range.setv({start: low, end: low + 60})",
        ),
        "Plotly": (plotly, "Plotly.relayout('plot', {'xaxis.range': [low, low + 60]})"),
    }
    found = {}
    for name, (html, zoom) in zooms.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "peer.html"
            path.write_text(html, encoding="utf-8")
            page = opened(browser, path.as_uri())
            page.wait_for_timeout(1000)
            script = f"async (low) => {{ {UNTIL_DRAWN} return await timed(() => {zoom}); }}"
            found[name] = statistics.median(page.evaluate(script, low) for low in range(2 * REPEATS)) / 1000
            page.close()
        row(f"zoom of 4 traces of 12,000 samples alone, {name}", found[name])
    print(f"Plotly takes {found['Plotly'] / found['Bokeh']:.2f} times as long")


@contextmanager
def served(records: Path) -> Iterator[tuple[str, float]]:
    """Address of `lumbar explore` on these records, and when it was started."""
    command = [sys.executable, "-m", "lumbar", "explore", str(records), "--port", "0", "--no-browser"]
    begin = time.perf_counter()
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        yield server.stdout.readline().split()[0], begin
    finally:
        server.terminate()
        server.wait(60)


def of_server(browser: Browser, records: Path) -> None:
    """The served page: first picture after the command, and fits that one asks for."""
    with served(records) as (address, begin):
        row("lumbar explore: address is printed", time.perf_counter() - begin)
        page = browser.new_page(viewport={"width": 1280, "height": 1800})
        page.set_default_timeout(WAIT_MS)
        page.goto(address)
        page.wait_for_selector("canvas, svg")
        row("lumbar explore: first picture", time.perf_counter() - begin, AIMS["first picture"])
        page.wait_for_selector("body[data-ready=yes]")
        row("lumbar explore: diagnosis and all its pictures", time.perf_counter() - begin)
        refits = [asked for asked in (refit(page, number) for number in range(4)) if asked is not None]
        row(f"refit with one effect more, the slowest of {len(refits)}", max(refits), AIMS["refit"])
        page.close()


def refit(page: Page, number: int) -> float | None:
    """Seconds from a click on a card to the ladder; None where that model was there already."""
    button = page.locator("[data-add]").nth(-1 - number)
    page.evaluate("document.getElementById('message').textContent = ''")
    begin = time.perf_counter()
    button.click()
    page.wait_for_function(
        "() => !document.body.hasAttribute('aria-busy') && document.getElementById('message').textContent"
    )
    seconds = time.perf_counter() - begin
    fitted = "Fitted in" in page.locator("#message").inner_text()
    if not page.locator("#undo").is_disabled():
        page.locator("#undo").click()
    return seconds if fitted else None


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plotly", type=Path, metavar="FILE", help="plotly.min.js to compare with")
    options = parser.parse_args()
    if CHROMIUM is None:
        sys.exit("no Chromium here: install it (Debian: apt-get install chromium)")
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as name:
        arguments = ["--no-sandbox"] if os.getuid() == 0 else []
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=arguments)
        records = experiment(Path(name) / "records")
        of_file(browser, records, Path(name))
        of_server(browser, records)
        if options.plotly:
            beside_plotly(browser, options.plotly)
        browser.close()


if __name__ == "__main__":
    main()
