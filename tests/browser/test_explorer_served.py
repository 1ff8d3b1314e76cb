"""Pages in a real browser at the addresses of ``lumbar explore``: of a folder, and for uploads."""

import json
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from accessibility import WIDTHS, fits, serious
from explorer_steps import CASE, add, errors_of

pytestmark = pytest.mark.nightly


@contextmanager
def serving(folder: Path, *arguments: str):
    """Run ``lumbar explore`` there; the addresses that it prints, by their paths."""
    command = [sys.executable, "-m", "lumbar", "explore", *arguments, "--port", "0", "--no-browser"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as server:
        try:
            printed = iter(
                server.stdout.readline,
                "Anyone with an address may use its page; Ctrl-C ends it.\n",
            )
            addresses = [line.split()[0] for line in printed]
            yield {urlsplit(address).path: address for address in addresses}
        finally:
            server.terminate()


@pytest.fixture
def served(shared, tmp_path):
    """A folder of a blind experiment, and the addresses at which it is served."""
    folder = shutil.copytree(shared / "hidden_effects" / CASE, tmp_path / "data")
    with serving(tmp_path, str(folder)) as addresses:
        yield tmp_path, addresses


def test_from_a_blind_experiment_to_a_model(new_page, served):
    folder, addresses = served
    page = new_page(addresses["/records"], color_scheme="dark")
    mine = new_page(addresses["/_own"], ready="#choose")
    add(page, "coulomb_friction")
    assert errors_of(page)[-1] < 0.25 * errors_of(page)[0]
    add(page, "inertia")  # computed on the server
    page.wait_for_function("document.querySelectorAll('#ladder .rung').length === 3")
    assert "Fitted in" in page.locator("#message").inner_text()
    assert page.locator("#chip").inner_text() == "only noise is left"
    page.reload()  # what was fitted is there again, and the address says what is shown
    page.wait_for_selector("body[data-ready=yes]")
    page.wait_for_function("document.querySelectorAll('#ladder .rung').length === 3")
    page.get_by_role("button", name="inertia earlier").click()
    page.wait_for_function(
        "document.querySelectorAll('#ladder .rung')[1].textContent.startsWith('+ inertia')"
    )
    assert errors_of(page)[1] > errors_of(page)[2]
    page.get_by_role("button", name="coulomb friction out").click()
    page.locator("summary", has_text="How sure is that?").click()
    with page.expect_download() as given:
        page.get_by_role("button", name="Excitation file that tells the model shown").click()
    assert Path(given.value.path()).read_text(encoding="utf-8").startswith("time_s,position_mm")
    page.get_by_role("button", name="Undo").click()
    page.get_by_role("button", name="inertia out").click()
    page.get_by_role("button", name="Write model, tables, figures and FMU").click()
    page.wait_for_function("document.getElementById('message').textContent.includes('files written')")
    written = json.loads((folder / "explored" / "data" / "refined.json").read_text(encoding="utf-8"))
    shown = page.evaluate(
        "JSON.parse(document.getElementById('page-data').textContent).models.coulomb_friction.test_rms"
    )
    assert written["models"][-1]["scores"]["test_rms"] == pytest.approx(shown, rel=1e-9)
    give_own(mine, folder / "foreign")


SCRIPT = "<img src=x onerror=alert(1)>"


def give_own(page, folder: Path) -> None:
    """Give two files of a machine where the keyboard leads, say what the force's unit is, and wait for the diagnosis."""
    folder.mkdir()
    for name in ("multisine", "chirp"):
        text = (folder.parent / "data" / f"{name}.csv").read_text(encoding="utf-8")
        header = f"Zeit [s];Weg [mm];Kraft {SCRIPT}"
        rows = text.split("\n", 1)[1].replace(",", ";").replace(".", ",")
        (folder / f"{name} {SCRIPT}.txt").write_text(f"{header}\n{rows}", encoding="utf-8")
    page.keyboard.press("Tab")
    while page.evaluate("document.activeElement.id") != "choose":
        page.keyboard.press("Tab")
    # Set, not chosen in a dialog: Chromium driven from outside swallows one now and then.
    page.locator("#choose").set_input_files(sorted(folder.iterdir()))
    page.locator("#files li").nth(1).wait_for()
    page.locator("#force_unit-wrong", has_text="give “Unit of force”").wait_for()
    assert SCRIPT in page.locator("#files").inner_text()
    assert page.locator("img").count() == 0
    page.get_by_label("Unit of force").fill("N")
    page.keyboard.press("Tab")
    page.locator("#start:enabled").wait_for()
    assert page.locator("#training input:checked").count() == 1
    page.get_by_label("Name of the set").fill("mine")
    page.keyboard.press("Enter")
    page.wait_for_selector("body[data-ready=yes]")
    page.get_by_role("button", name="Show the best model").click()
    page.locator("#sentence", has_text="missing coulomb friction").wait_for()


@pytest.fixture(scope="module")
def upload_page(tmp_path_factory):
    """Address of the page for uploads, served outside a project."""
    with serving(tmp_path_factory.mktemp("own")) as addresses:
        yield addresses["/"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_upload_page_is_accessible(new_page, upload_page, scheme):
    options = {"color_scheme": scheme, "bypass_csp": True}  # axe-core is an external script
    page = new_page(upload_page, ready="#choose", viewport={"width": 390, "height": 844}, **options)
    page.locator("#choose").set_input_files(
        [{"name": f"{'x' * 150}.csv", "mimeType": "text/csv", "buffer": b"t_s,pos_mm,F_N\n1,2\n" * 20}]
    )
    page.locator("#files li").wait_for()
    page.locator("#previews .bad").first.wait_for()
    fits(page, *WIDTHS)
    assert page.locator("#start").is_disabled()
    assert serious(page) == []


def test_fields_show_the_columns_and_notes_are_not_errors(new_page, upload_page):
    page = new_page(upload_page, ready="#choose")
    time = 10 * np.arange(400)
    columns = zip(time, np.sin(time / 70), np.cos(time / 90), strict=True)
    rows = "".join(f"{at};{way:.4f};{force:.4f}\n" for at, way, force in columns)
    file = {
        "name": "found.csv",
        "mimeType": "text/csv",
        "buffer": f"Zeit [ms];Weg [mm];Kraft [N]\n{rows}".encode(),
    }
    page.locator("#choose").set_input_files([file])
    page.locator("#previews svg").first.wait_for()
    chosen = page.locator("#position option:checked").inner_text()
    assert "Weg" in chosen and "found" in chosen
    assert page.locator("#time_unit").get_attribute("placeholder") == "ms (found)"
    points = page.locator("#previews polyline").first.get_attribute("points").split()
    drawn = np.array([point.split(",") for point in points], dtype=float)
    np.testing.assert_allclose(drawn[:, 0], np.linspace(0, 1, 400), atol=1e-4)  # every sample in its place
    position = np.sin(time / 70).round(4)
    np.testing.assert_allclose(drawn[:, 1], 1 - (position - position.min()) / np.ptp(position), atol=2e-4)
    page.get_by_label("Change the sign of the force").check()
    note = page.locator("#previews p", has_text="the sign of the force is changed")
    note.wait_for()
    assert note.get_attribute("class") == "note"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_index_and_unknown_addresses_are_accessible(new_page, upload_page, scheme):
    page = new_page(f"{upload_page}#choose", ready="#choose", color_scheme=scheme, bypass_csp=True)
    assert page.url.endswith("#choose") and "token" not in page.url
    assert page.get_by_role("link", name="an example to try").is_visible()
    fits(page, *WIDTHS)
    assert serious(page) == []
    page.goto(f"{upload_page.partition('?')[0]}nowhere")
    fits(page, *WIDTHS)
    assert serious(page) == []
    page.get_by_role("link", name="All pages").click()
    page.wait_for_selector("#choose")
    page.locator("#choose").set_input_files(
        [{"name": "a.csv", "mimeType": "text/csv", "buffer": b"t_s\n1\n"}]
    )
    page.locator("#files li").wait_for()
    assert not page.locator("#listed").is_visible()  # what comes next is what is seen
