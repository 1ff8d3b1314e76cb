"""The page of a diagnosis in a real browser, as a file."""

import csv
import re
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from accessibility import WIDTHS, fits, serious
from explorer_steps import ONE_SCREEN, add, errors_of, path_of

import lumbar
from lumbar.settings.twin import TwinSettings
from lumbar.twin.two_hidden_effects import two_hidden_effects, write_records

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory):
    """Records with two hidden effects."""
    folder, settings = tmp_path_factory.mktemp("records"), TwinSettings()
    write_records(folder, two_hidden_effects(settings.two_hidden_effects, settings.seed))
    return lumbar.diagnose(lumbar.read(folder))


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


def unfold(page, title: str) -> None:
    page.locator("summary", has_text=title).click()


def state_of(page) -> dict:
    """Return what every step changes: figures, sentences, length of the last bar, and the drawn residual."""
    return page.evaluate(
        "() => ({fall: document.getElementById('fall').textContent, sentence: document.getElementById('sentence').textContent,"
        " headline: document.getElementById('headline').textContent,"
        " bar: [...document.querySelectorAll('#ladder .bar')].at(-1).getBoundingClientRect().width,"
        " residual: Math.hypot(...lumbar.whole().model_error)})"
    )


@pytest.mark.parametrize("size", [(1440, 900), (1280, 720)])
def test_each_added_effect_changes_error_curve_and_sentence_on_one_screen(new_page, saved, diagnosis, size):
    """The page opens unsolved at the base; every step of the automatic path lowers the visible bar."""
    width, height = size
    page = new_page(saved, viewport={"width": width, "height": height}, reduced_motion="reduce")
    assert errors_of(page) == pytest.approx([diagnosis.result.base.test_rms], rel=0.005)
    shown = page.locator("body").inner_text()
    assert (
        "is missing coulomb friction" not in shown and "complete" not in page.locator("#verdict").inner_text()
    )
    states = [state_of(page)]
    for effect in diagnosis.selected:
        add(page, effect)
        page.drawn()
        states.append(state_of(page))
        for part in ONE_SCREEN:
            box = page.locator(part).bounding_box()
            assert box["x"] >= 0 and box["y"] >= 0, part
            assert box["x"] + box["width"] <= width and box["y"] + box["height"] <= height, part
        assert page.locator("#picture-residual canvas").first.bounding_box()["height"] > 40
    for before, after in pairwise(states):
        assert after["bar"] < 0.97 * before["bar"]
        assert all(after[name] != before[name] for name in ("fall", "sentence", "headline", "residual"))
    assert page.locator("#chip").inner_text() == "complete"
    assert "is missing coulomb friction and hardening stiffness" in page.locator("#sentence").inner_text()
    assert page.evaluate("scrollY") == 0


def test_the_best_model_is_shown_step_by_step_on_request(new_page, saved, diagnosis):
    page = new_page(saved, reduced_motion="reduce")
    page.get_by_role("button", name="Show the best model").click()
    page.locator("#chip", has_text="complete").wait_for()
    assert errors_of(page) == pytest.approx([item.test_rms for item in diagnosis.result.path], rel=0.005)
    page.get_by_role("button", name="Undo").click()
    assert path_of(page) == [diagnosis.selected[0].replace("_", " ")]
    assert page.locator("#chip").inner_text() == "something is missing"
    place = page.locator("#places button").first
    effect = place.get_attribute("data-add")
    place.click()
    assert path_of(page)[-1] == effect.replace("_", " ")


def test_page_from_disk_shows_what_was_computed(new_page, saved, diagnosis):
    page = new_page(saved)
    for effect in diagnosis.selected:
        add(page, effect)
    before, *_, after = errors_of(page)
    assert after < 1.1 * diagnosis.result.experiment.floor.rms < before
    add(page, "inertia")
    names = "".join(f" --add {name}" for name in (*diagnosis.selected, "inertia"))
    command = f"lumbar refine FOLDER --base KB --train multisine{names} --output out"
    assert command in page.locator("#message").inner_text()
    assert path_of(page) == [name.replace("_", " ") for name in diagnosis.selected]
    unfold(page, "Models × records")
    page.locator("#other").select_option("KB:arx")
    assert page.locator("#name-other").inner_text() == "KB (ARX)"
    records = page.locator("#merits thead th").all_inner_texts()
    row = page.locator("#merits tbody tr", has_text="KB (ARX)").locator("td, th").all_inner_texts()
    chirp = next(record for record in diagnosis.records if record.name == "chirp")
    error = chirp["output"][50:] - lumbar_model(diagnosis, "KB", "arx").simulate(chirp)[50:]
    assert float(row[records.index("chirp (unseen)")]) == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.005)
    assert all(url.startswith(("file:", "data:", "blob:")) for url in page.asked)


def test_a_region_drawn_in_one_picture_is_marked_in_all(new_page, saved):
    page = new_page(saved, viewport={"width": 1280, "height": 1800})
    unfold(page, "More pictures")
    page.drawn()
    box = page.locator("#picture-plane canvas").first.bounding_box()
    region = page.locator("#region", has_text="samples marked")
    for _ in range(20):  # a page that is busy misses a pointer
        if not region.count():
            page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 20)
            page.mouse.down()
            page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.7 * box["height"], steps=3)
            page.mouse.up()
            page.wait_for_timeout(1000)
    region.wait_for()
    marked = page.evaluate(
        "() => { const [all, some] = [lumbar.whole(), Bokeh.documents[0].get_model_by_name('brushed').data];"
        " const at = (i) => all.position[all.time.indexOf(some.time[i])];"
        " return {count: some.time.length, positions: some.position.every((value, i) => value === at(i))}; }"
    )
    assert region.inner_text().startswith(f"{marked['count']} samples marked")
    assert marked["count"] > 100 and marked["positions"]


def test_pictures_of_the_error_are_those_of_numpy(new_page, saved, diagnosis):
    """Mean error over depth by direction and around reversals, and what a band of frequencies holds of the error."""
    page = new_page(saved)
    page.locator("#record").select_option("multisine")
    unfold(page, "More pictures")
    shown, depth, turns = (data_of(page, name) for name in ("whole", "depth means", "turn means"))
    edges = np.linspace(shown["position"].min(), shown["position"].max(), 25)
    cell = np.clip(np.searchsorted(edges, shown["position"], side="right") - 1, 0, 23)
    for way, sign in (("advancing", 1), ("retracting", -1)):
        inside = (cell == 12) & (sign * shown["velocity"] > 0)
        assert depth[f"model_{way}"][12] == pytest.approx(shown["model_error"][inside].mean(), rel=1e-3)
    middle = len(turns["since"]) // 2
    near = np.floor(shown["since"] / turns["since"][middle + 1] + 0.5) == 1
    assert turns["model"][middle + 1] == pytest.approx(shown["model_turned"][near].mean(), rel=1e-3)

    page.evaluate(
        "window.lumbar.brushBand({final: true, geometry: {type: 'rect', x0: 3, x1: 6, y0: 0, y1: 1}})"
    )
    error = shown["model_error"]
    frequency = np.fft.rfftfreq(error.size, shown["time"][1] - shown["time"][0])
    part = np.fft.irfft(np.where((frequency >= 3) & (frequency <= 6), np.fft.rfft(error), 0), error.size)
    marked = np.count_nonzero(np.abs(part) > np.sqrt(np.mean(part**2)))
    message = page.locator("#region").inner_text()
    assert f"hold {100 * np.sum(part**2) / np.sum(error**2):.3g} % of the model's error" in message
    assert int(re.search(r"(\d+) samples marked", message)[1]) == pytest.approx(marked, abs=3)

    page.locator("#from").fill("0")  # all samples: their density holds the error's variance (Parseval)
    page.locator("#to").fill("1000")
    page.keyboard.press("Tab")
    lines = data_of(page, "brushed lines")
    power = np.sum(lines["density"] ** 2) * (lines["frequency"][1] - lines["frequency"][0])
    assert power == pytest.approx(np.mean(error**2), rel=0.02)


def test_two_paths_are_compared_and_kept_in_the_address(new_page, saved):
    page = new_page(saved)
    assert "#" not in page.url
    for effect in ("hardening_stiffness", "coulomb_friction"):
        add(page, effect)
    page.get_by_role("button", name="Set aside").click()
    page.get_by_role("button", name="Base alone").click()
    add(page, "hysteresis")
    assert page.locator("#name-other").inner_text() == "KB + coulomb friction + hardening stiffness"
    page.get_by_role("button", name="Swap the paths").click()
    page.get_by_role("button", name="coulomb friction earlier").click()
    assert path_of(page) == ["coulomb friction", "hardening stiffness"]
    page.get_by_role("button", name="hardening stiffness out").click()
    page.locator("#record").select_option("multisine")
    unfold(page, "Models × records")
    page.locator("#other").select_option("KB:arx")
    page.get_by_role("link", name="3 Add").click()  # a link within the page leaves the session where it is
    page.wait_for_function("location.hash.includes('path=')")
    address = page.url
    assert address.endswith("#path=coulomb_friction&aside=hysteresis&record=multisine&compare=KB%3Aarx")
    for again in (new_page(address), page):
        if again is page:
            page.reload()
            page.wait_for_selector("body[data-ready=yes]")
        assert path_of(again) == ["coulomb friction"]
        assert "hysteresis" in again.locator("#ladder-aside .rung").last.inner_text()
        assert [again.locator(f"#{name}").input_value() for name in ("record", "other")] == [
            "multisine",
            "KB:arx",
        ]


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
    assert path_of(page) == []


def test_files_are_handed_out_without_a_server(new_page, saved, tmp_path):
    page = new_page(saved)
    for title in ("More pictures", "Models × records", "How sure is that?"):
        unfold(page, title)
    page.drawn()
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
    page.get_by_role("button", name="Excitation file that tells the model shown").click()
    assert "was not computed" in page.locator("#message").inner_text()


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
def test_axe_finds_nothing_serious_and_nothing_is_wider_than_the_page(new_page, saved, scheme, width):
    page = new_page(saved, viewport={"width": width, "height": 900}, color_scheme=scheme)
    for effect in ("hardening_stiffness", "coulomb_friction"):
        add(page, effect)
    page.get_by_role("button", name="Set aside").click()
    add(page, "inertia")  # the message is there
    fits(page, *WIDTHS, 1920)
    for fold in page.locator("summary").all():
        fold.click()
    page.drawn()
    assert serious(page) == []
    fits(page, *WIDTHS)


def test_what_is_drawn_in_the_dark_stands_out_and_what_is_folded_is_printed(new_page, saved):
    page = new_page(saved, color_scheme="dark")
    add(page, "hysteresis")
    colours = page.evaluate(
        "() => Bokeh.documents[0].roots().flatMap((picture) => picture.renderers).map(({ glyph }) => glyph.line_color?.value)"
        ".concat([...document.querySelectorAll('.curve, .bar')].map((key) => key.style.getPropertyValue('--hue')))"
    )
    lines = {colour.lower() for colour in colours if isinstance(colour, str) and colour.startswith("#")}
    assert len(lines) >= 4
    paper = luminance(page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--paper')"))
    assert all((luminance(colour) + 0.05) / (paper + 0.05) >= 3 for colour in lines), lines
    folded = page.locator("#evidence table").nth(1)
    assert not folded.is_visible()
    page.emulate_media(media="print")
    assert folded.is_visible()
    assert page.locator(".bar").first.evaluate("bar => getComputedStyle(bar).printColorAdjust") == "exact"


def luminance(colour: str) -> float:
    """Relative luminance of a colour ``#rrggbb`` (WCAG 2)."""
    parts = [int(colour.strip()[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))
