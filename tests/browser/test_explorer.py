"""The page of a diagnosis in a real browser, as a file."""

import csv
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from accessibility import WIDTHS, fits, serious
from explorer_steps import CASE, add, errors_of

import lumbar

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def diagnosis(shared):
    return lumbar.diagnose(lumbar.read(shared / "hidden_effects" / CASE))


@pytest.fixture(scope="module")
def saved(diagnosis, tmp_path_factory):
    """Address of its page as a file."""
    path = tmp_path_factory.mktemp("saved") / "diagnosis.html"
    path.write_text(diagnosis.page().to_html(), encoding="utf-8")
    return path.as_uri()


def lumbar_model(diagnosis, name, estimator):
    return next(
        item for item in diagnosis.thesis_models[0] if (item.name, item.estimator) == (name, estimator)
    )


def data_of(page, name: str) -> dict:
    """Columns of one of the page's sources, or of the whole record."""
    columns = page.evaluate(
        "(name) => Object.fromEntries(Object.entries("
        "name === 'whole' ? lumbar.whole() : Bokeh.documents[0].get_model_by_name(name).data)"
        ".map(([column, values]) => [column, Array.from(values)]))",
        name,
    )
    return {
        column: np.array([np.nan if value is None else value for value in values])
        for column, values in columns.items()
    }


def test_page_from_disk_shows_what_was_computed(new_page, saved, diagnosis):
    page = new_page(saved)
    assert "missing coulomb friction" in page.locator(".headline").first.inner_text()
    page.get_by_role("button", name="Base alone").click()
    assert len(errors_of(page)) == 1
    add(page, "Coulomb friction")
    before, after = errors_of(page)
    assert after < 1.1 * diagnosis.result.experiment.floor.rms < before
    add(page, "Inertia")
    assert "were not fitted in this diagnosis" in page.locator("#message").inner_text()
    page.locator("#record").select_option("chirp")
    page.locator("#first").select_option("KB:arx")
    row = page.locator("#merits tr[aria-current]").inner_text().split("\t")
    chirp = next(record for record in diagnosis.records if record.name == "chirp")
    error = chirp["output"][50:] - lumbar_model(diagnosis, "KB", "arx").simulate(chirp)[50:]
    assert row[:2] == ["chirp", "unseen"]
    assert float(row[2]) == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.005)
    assert all(url.startswith(("file:", "data:", "blob:")) for url in page.asked)


def test_a_region_drawn_in_one_picture_is_marked_in_all(new_page, saved):
    page = new_page(saved, viewport={"width": 1280, "height": 1800})
    box = page.locator("figure.wide").nth(0).locator("canvas").first.bounding_box()
    region = page.locator("#region", has_text="samples marked")
    for _ in range(20):  # a page that is busy misses a pointer
        if not region.count():
            page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 20)
            page.mouse.down()
            page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.8 * box["height"], steps=3)
            page.mouse.up()
            page.wait_for_timeout(1000)
    region.wait_for()
    marked = page.evaluate(
        "() => { const of = (name) => Bokeh.documents[0].get_model_by_name(name).data;"
        " const [all, some] = [lumbar.whole(), of('brushed')];"
        " return {count: some.time.length, times: [Math.min(...some.time), Math.max(...some.time)],"
        " positions: some.position.every((value, i) => value === all.position[all.time.indexOf(some.time[i])])}; }"
    )
    assert region.inner_text().startswith(f"{marked['count']} samples marked")
    assert marked["count"] > 100 and marked["positions"]
    assert 0 < marked["times"][0] < marked["times"][1] < 100


def test_pictures_of_the_error_are_those_of_numpy(new_page, saved, diagnosis):
    """Mean error over depth by direction and around reversals, and what a band of frequencies holds of the error."""
    page = new_page(saved)
    shown, depth, turns = (data_of(page, name) for name in ("whole", "depth means", "turn means"))
    edges = np.linspace(shown["position"].min(), shown["position"].max(), 25)
    cell = np.clip(np.searchsorted(edges, shown["position"], side="right") - 1, 0, 23)
    for way, sign in (("advancing", 1), ("retracting", -1)):
        inside = (cell == 12) & (sign * shown["velocity"] > 0)
        assert depth[f"first_{way}"][12] == pytest.approx(shown["first_error"][inside].mean(), rel=1e-3)
    step = turns["since"][1] - turns["since"][0]
    near = np.abs(shown["since"] - step) < step / 2
    middle = len(turns["since"]) // 2
    assert turns["first"][middle + 1] == pytest.approx(shown["first_turned"][near].mean(), rel=1e-3)

    page.evaluate(
        "window.lumbar.brushBand({final: true, geometry: {type: 'rect', x0: 3, x1: 6, y0: 0, y1: 1}})"
    )
    error = shown["first_error"]
    size = 2 ** int(np.ceil(np.log2(error.size)))
    frequency = np.fft.rfftfreq(size, 0.01)
    part = np.fft.irfft(np.where((frequency >= 3) & (frequency <= 6), np.fft.rfft(error, size), 0))[
        : error.size
    ]
    marked = np.count_nonzero(np.abs(part) > np.sqrt(np.mean(part**2)))
    message = page.locator("#region").inner_text()
    assert f"hold {100 * np.sum(part**2) / np.sum(error**2):.3g} % of the first model's error" in message
    assert int(re.search(r"(\d+) samples marked", message)[1]) == pytest.approx(marked, abs=3)

    page.locator("#from").fill("0")  # all samples: their density holds the error's variance (Parseval)
    page.locator("#to").fill("1000")
    page.keyboard.press("Tab")
    lines = data_of(page, "brushed lines")
    power = np.sum(lines["density"] ** 2) * (lines["frequency"][1] - lines["frequency"][0])
    assert power == pytest.approx(np.mean(error**2), rel=0.02)


def test_two_paths_are_compared_and_reordered_with_what_was_computed(new_page, saved):
    page = new_page(saved)
    page.get_by_role("button", name="Set this path aside").click()
    page.get_by_role("button", name="Base alone").click()
    add(page, "Hysteresis")
    assert "set aside" in page.locator("#paths").inner_text()
    own, other = (page.locator(f"#{name} li").last.inner_text() for name in ("ladder", "ladder-aside"))
    assert "hysteresis" in own and "coulomb friction" in other
    page.get_by_role("button", name="Swap the paths").click()
    assert "coulomb friction" in page.locator("#ladder li").last.inner_text()
    page.get_by_role("button", name="Undo").click()
    assert "hysteresis" in page.locator("#ladder li").last.inner_text()
    page.get_by_role("button", name="hysteresis out").click()
    assert len(errors_of(page)) == 1


def test_the_address_holds_the_session_and_opens_it_again(new_page, saved):
    page = new_page(saved)
    assert "#" not in page.url
    page.get_by_role("button", name="Set this path aside").click()
    page.get_by_role("button", name="Base alone").click()
    add(page, "Hysteresis")
    page.locator("#record").select_option("chirp")
    page.locator("#first").select_option("KB:arx")
    page.get_by_role("link", name="Evidence").click()  # a link within the page leaves the session where it is
    page.wait_for_function("location.hash.includes('path=')")
    address = page.url
    assert address.endswith("#path=hysteresis&aside=coulomb_friction&record=chirp&first=KB%3Aarx")
    for again in (new_page(address), page):
        if again is page:
            page.reload()
            page.wait_for_selector("body[data-ready=yes]")
        assert "hysteresis" in again.locator("#ladder li").last.inner_text()
        assert "coulomb friction" in again.locator("#ladder-aside li").last.inner_text()
        chosen = [again.locator(f"#{name}").input_value() for name in ("record", "first", "second")]
        assert chosen == ["chirp", "KB:arx", "hysteresis"]


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("path=inertia+drift", "this diagnosis did not fit inertia and drift"),
        ("path=%zz", "The address cannot be followed"),
        ("path=drift+drift", "names an effect twice"),
    ],
)
def test_wrong_address_is_answered_with_a_message(new_page, saved, address, message):
    page = new_page(f"{saved}#{address}")
    assert message in page.locator("#message").inner_text()
    assert "coulomb friction" in page.locator("#ladder li").last.inner_text()


def test_files_are_handed_out_without_a_server(new_page, saved, tmp_path):
    page = new_page(saved)
    with page.expect_download() as given:
        page.get_by_role("button", name="Spectrum of the error").click()
    given.value.save_as(tmp_path / "spectrum.svg")
    assert ElementTree.parse(tmp_path / "spectrum.svg").getroot().tag == "{http://www.w3.org/2000/svg}svg"
    with page.expect_download() as given:
        page.get_by_role("button", name="Every model on every record").click()
    given.value.save_as(tmp_path / "models.csv")
    rows = list(csv.DictReader((tmp_path / "models.csv").open(encoding="utf-8")))
    assert {row["record"] for row in rows} == {"multisine", "noise", "chirp"}
    assert {"KB", "KB (ARX)", "KB (output error)", "KB+coulomb_friction"} <= {row["model"] for row in rows}
    page.get_by_role("button", name="Excitation file that tells Hysteresis").click()
    assert "was not computed" in page.locator("#message").inner_text()


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
def test_axe_finds_nothing_serious_and_nothing_is_wider_than_the_page(new_page, saved, scheme, width):
    page = new_page(saved, viewport={"width": width, "height": 900}, color_scheme=scheme)
    page.get_by_role("button", name="Set this path aside").click()
    add(page, "Inertia")  # the message is there
    assert serious(page) == []
    fits(page, *WIDTHS, 1920)


def test_what_is_drawn_in_the_dark_stands_out_and_what_is_folded_is_printed(new_page, saved):
    page = new_page(saved, color_scheme="dark")
    colours = page.evaluate(
        "() => Bokeh.documents[0].roots().flatMap((picture) => picture.renderers).map(({ glyph }) => glyph.line_color?.value)"
        ".concat([...document.querySelectorAll('.key')].map((key) => key.style.getPropertyValue('--hue')))"
    )
    lines = {colour.lower() for colour in colours if isinstance(colour, str) and colour.startswith("#")}
    assert len(lines) >= 4
    paper = luminance(page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--paper')"))
    assert all((luminance(colour) + 0.05) / (paper + 0.05) >= 3 for colour in lines), lines
    folded = page.locator("#evidence table").first
    assert not folded.is_visible()
    page.emulate_media(media="print")
    assert folded.is_visible()
    assert page.locator(".bar").first.evaluate("bar => getComputedStyle(bar).printColorAdjust") == "exact"


def luminance(colour: str) -> float:
    """Relative luminance of a colour ``#rrggbb`` (WCAG 2)."""
    parts = [int(colour.strip()[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))
