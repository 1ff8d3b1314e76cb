"""Table and figure of the exported models."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from lumbar.publishing.figures.runtime_figures import fmu_force_figure
from lumbar.publishing.figures.style import save
from lumbar.tissue.fmu.build.reference_response import push_profile, reference_output
from lumbar.tissue.fmu.check.check_table import check_table
from lumbar.tissue.fmu.check.fmu_check import check_fmus, check_input
from lumbar.tissue.fmu.check.reference_stimulus import push

needs_linux = pytest.mark.skipif(
    not sys.platform.startswith("linux"),
    reason="the FMUs hold binaries for x86_64 Linux only: use such a machine",
)


@needs_linux
def test_table_says_when_the_feedthrough_acts(fmu_models, fmu_folder, tmp_path):
    table = check_table(check_fmus(fmu_models, fmu_folder, 100, 3), "synthetic twin", 3)
    found = dict(zip(table.frame["file"], table.frame["feedthrough"], strict=True))
    assert found["KB_fmi2.fmu"] == "one sample late"
    assert found["KB_fmi3.fmu"] == "at once"
    assert found["MW_fmi2.fmu"] == found["MW_fmi3.fmu"] == "none"
    table.write(tmp_path / "fmu_check")
    assert "Data: synthetic twin" in (tmp_path / "fmu_check.html").read_text(encoding="utf-8")


@needs_linux
def test_figure_has_units_and_is_the_same_at_every_run(fmu_models, fmu_folder, tmp_path):
    for name in ("first", "second"):
        played = push(fmu_models, fmu_folder)
        figure = fmu_force_figure(
            played.time, played.inputs, played.outputs, played.most_delayed(), "Position (mm)", "Force (N)"
        )
        labels = [axes.get_ylabel() for axes in figure.axes]
        assert labels[:2] == ["Position (mm)", "Force (N)"]
        assert labels[2] in ("Force of KB (N)", "Force of HO (N)")
        save(figure, tmp_path / name, "synthetic twin")
    for ending in ("svg", "pdf"):
        first, second = ((tmp_path / f"{name}.{ending}").read_bytes() for name in ("first", "second"))
        assert first == second


def test_push_profile_rises_holds_and_falls():
    time, profile = push_profile(0.01)
    assert len(time) == 131
    assert (profile.min(), profile.max()) == (0.0, 1.0)
    np.testing.assert_allclose(profile[(time < 0.1) | (time > 1.0)], 0.0, atol=1e-12)
    np.testing.assert_allclose(profile[(time > 0.35) & (time < 0.75)], 1.0)
    # Half-way up a half cosine of 0.25 s.
    assert np.interp(0.225, time, profile) == pytest.approx(0.5, abs=2e-3)


def test_check_input_uses_the_range_and_its_seed_counts(fmu_models):
    for model in fmu_models:
        inputs = check_input(model, 500, 1)
        np.testing.assert_array_equal(inputs, check_input(model, 500, 1))
        assert not np.array_equal(inputs, check_input(model, 500, 2))
        reference = reference_output(model, inputs, "3.0")
        assert 0.7 * 15 < np.abs(reference).max() <= 0.8 * 15 + 1e-9
        assert 0 < model.dynamics.rounding_bound(inputs, reference) < 1e-9
