"""The page of a diagnosis in a real browser: as a file, and served beside a study."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import lumbar
from running import FORKING, copy_project, snakemake

CASE = "case_03"
STUDY = """
study: blind
title: A blind experiment
data: recordings
data_root: {folder}
data_source: {{name: a blind experiment, licence: the project's, obtain: beside the project}}
chapters: [tissue, improvement]
tissue:
  # the page may add to this file
  records:
    - {{name: multisine, file: multisine.csv, period_s: 10}}
    - {{name: noise, file: noise.csv}}
    - {{name: chirp, file: chirp.csv}}
  training: [multisine]
improvement:
  train: multisine
  record_sets: [{{name: tissue}}]
"""


@pytest.fixture(scope="module")
def saved(shared, tmp_path_factory):
    """Folder of a saved diagnosis."""
    folder = tmp_path_factory.mktemp("saved")
    diagnosis = lumbar.diagnose(lumbar.read(shared / "hidden_effects" / CASE))
    diagnosis.save(folder, pictures=False)
    return folder


def errors_of(page) -> list[float]:
    """Error of every rung of the ladder on unseen records."""
    rungs = page.locator("#ladder li").all_inner_texts()
    return [float(re.search(r": ([\d.]+) N unseen", rung)[1]) for rung in rungs]


def add(page, title: str) -> None:
    page.locator("article.card").filter(has=page.get_by_role("heading", name=title)).get_by_role(
        "button", name="Add"
    ).click()


def test_page_from_disk_shows_what_was_computed(new_page, saved):
    page = new_page((saved / "diagnosis.html").as_uri())
    assert "missing coulomb friction" in page.locator(".headline").first.inner_text()
    page.get_by_role("button", name="Base alone").click()
    assert len(errors_of(page)) == 1
    add(page, "Coulomb friction")
    before, after = errors_of(page)
    noise = json.loads((saved / "diagnosis.json").read_text(encoding="utf-8"))["noise_floor_rms"]
    assert after < 1.1 * noise < before
    add(page, "Inertia")
    assert "were not fitted in this diagnosis" in page.locator("#message").inner_text()
    page.get_by_label("Record").select_option("chirp")
    row = page.locator("#merits tr").nth(2).inner_text().split("\t")
    assert row[0] == "KB+coulomb_friction"
    assert all(url.startswith(("file:", "data:", "blob:")) for url in page.asked)


def test_a_region_drawn_in_one_picture_is_marked_in_all(new_page, saved):
    page = new_page((saved / "diagnosis.html").as_uri(), viewport={"width": 1280, "height": 1800})
    picture = page.locator("figure.wide").nth(0).locator("canvas").first
    box = picture.bounding_box()
    page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.8 * box["height"], steps=3)
    page.mouse.up()
    page.wait_for_function("document.getElementById('region').textContent.includes('samples marked')")
    marked = page.evaluate(
        "() => { const of = (name) => Bokeh.documents[0].get_model_by_name(name).data;"
        " const [all, some] = [of('shown'), of('brushed')];"
        " return {count: some.time.length, times: [Math.min(...some.time), Math.max(...some.time)],"
        " positions: some.position.every((value, i) => value === all.position[all.time.indexOf(some.time[i])])}; }"
    )
    told = page.locator("#region").inner_text()
    assert told.startswith(f"{marked['count']} samples marked")
    assert marked["count"] > 100 and marked["positions"]
    assert 0 < marked["times"][0] < marked["times"][1] < 100


def test_keyboard_reaches_every_choice(new_page, saved):
    page = new_page((saved / "diagnosis.html").as_uri())
    reached = set()
    for _ in range(30):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.textContent"))
    assert {"restart", "record", "first", "second"} <= reached


@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_nothing_is_wider_than_the_page(new_page, saved, width):
    page = new_page((saved / "diagnosis.html").as_uri(), viewport={"width": width, "height": 900})
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.fixture
def served(shared, tmp_path):
    """Project with a study of a blind experiment, and the address at which it is served."""
    project = copy_project(tmp_path / "project")
    study = project / "config" / "studies" / "blind.yaml"
    study.write_text(STUDY.format(folder=shared / "hidden_effects" / CASE), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "lumbar",
        "explore",
        "config/studies/blind.yaml",
        "--port",
        "0",
        "--no-browser",
    ]
    server = subprocess.Popen(command, cwd=project, stdout=subprocess.PIPE, text=True)
    yield project, server.stdout.readline().strip()
    server.terminate()
    server.wait(30)


def test_from_a_blind_experiment_to_the_workflow(new_page, served):
    project, address = served
    page = new_page(address)
    page.get_by_role("button", name="Base alone").click()
    add(page, "Coulomb friction")
    assert errors_of(page)[-1] < 0.25 * errors_of(page)[0]
    add(page, "Inertia")  # computed on the server
    page.wait_for_function("document.querySelectorAll('#ladder li').length === 3")
    page.get_by_role("button", name="Remove the last effect").click()
    page.get_by_role("button", name="Keep these effects").click()
    page.wait_for_selector("#diff:has-text('coulomb_friction')")
    page.get_by_role("button", name="Write it").click()
    page.wait_for_function("document.getElementById('message').textContent.includes('is written')")
    kept = page.evaluate(
        "JSON.parse(document.getElementById('page-data').textContent).models.coulomb_friction"
    )
    run = snakemake(
        project,
        *("--cores", "1", "results/blind/tissue/models.json", "--configfile", "config/studies/blind.yaml"),
        program=FORKING,
    )
    assert run.status == 0, run.text[-4000:]
    written = json.loads(Path(project, "results/blind/tissue/models.json").read_text(encoding="utf-8"))
    model = next(item for item in written["models"] if item["name"] == "KB+coulomb_friction")
    assert model["scores"]["test_rms"] == pytest.approx(kept["test_rms"], rel=1e-6)
    assert "# the page may add to this file" in (project / "config/studies/blind.yaml").read_text(
        encoding="utf-8"
    )
