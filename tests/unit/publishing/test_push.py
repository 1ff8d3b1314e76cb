"""Models that a reader pushes in the page: their WebAssembly against the catalogue's own simulation."""

import base64
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

import lumbar
from lumbar.base.templates import template
from lumbar.publishing.explorer.push import pushed_models
from lumbar.tissue.fmu.build.effect_model import effect_model
from lumbar.twin.examples import example_records

PLAY = """
import {{ readFileSync }} from "node:fs";
const push = JSON.parse(readFileSync({content!r}, "utf8"));
const [times, positions] = JSON.parse(readFileSync({motion!r}, "utf8"));
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const models = await Promise.all(push.models.map((model) => TissueForce.open(bytes(model.library), model.description)));
console.log(JSON.stringify(models.map((model) => times.map((time, i) => model.step(time, positions[i])))));
"""


@pytest.fixture(scope="module")
def models():
    fitted = lumbar.refine(example_records(), ["coulomb_friction"]).models
    return [fitted[0], fitted[-1]]


def test_pushed_models_answer_as_simulated(models, zig_cache, tmp_path):
    if shutil.which("node") is None:
        pytest.skip("no node here: it plays the WebAssembly as a browser does")
    push = pushed_models(models, str(zig_cache), "synthetic twin")
    times = np.arange(1500) / push["rate_Hz"]
    positions = push["rest"] + 0.3 * (push["highest"] - push["lowest"]) * np.sin(2 * np.pi * times)
    files = {"content": push, "motion": [times.tolist(), positions.tolist()]}
    for name, content in files.items():
        (tmp_path / name).write_text(json.dumps(content))
    script = tmp_path / "play.mjs"
    script.write_text(
        template("tissue/fmu/tissue_force.mjs").render()
        + PLAY.format(**{name: str(tmp_path / name) for name in files})
    )
    done = subprocess.run(["node", script], capture_output=True, text=True, check=True)
    for model, played in zip(models, json.loads(done.stdout), strict=True):
        expected = effect_model(model, 1e-3).response(positions - model.input.offset) + model.output.offset
        np.testing.assert_allclose(played, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_pushed_models_are_told_why_not(models, tmp_path):
    folder = tmp_path / "a file"
    folder.write_text("")
    push = pushed_models(models, str(folder / "cache"), "synthetic twin")
    assert push["models"] == [] and "runtime.compiler_cache" in push["remark"]


def test_page_holds_what_is_played():
    diagnosis = lumbar.diagnose(example_records())
    text = diagnosis.page().to_html()
    push = json.loads(re.search(r'id="page-data">(.*?)</script>', text, re.DOTALL)[1])["push"]
    assert [model["label"] for model in push["models"]] == [
        item.name.replace("_", " ") for item in diagnosis.models
    ]
    for model in push["models"]:
        # The page numbers its own parts anew and leaves the model's token alone.
        token = re.search('instantiationToken="([^"]*)"', model["description"])[1]
        assert token.encode() in base64.b64decode(model["library"])
    assert 'id="push"' in text and 'id="push"' not in diagnosis.page(thesis=False).to_html()
