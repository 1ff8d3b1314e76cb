"""The input check reads every recording and tells all problems of all files."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.checking import check_recordings
from lumbar.settings.plain import plain
from lumbar.settings.survey import SurveySettings

LAYOUT = {
    "columns": {
        "time": {"column": "time_s", "unit": "s"},
        "output": {"column": "force_N", "quantity": "force", "unit": "N"},
    }
}


def planned(path, **changes) -> dict:
    entry = {"chapter": "tissue", "set": "tissue", "reader": "columns", "path": str(path), "layout": LAYOUT}
    return entry | {"name": path.stem} | changes


def written(tmp_path, name, rate=100.0, samples=200):
    time = np.arange(samples) / rate
    path = tmp_path / name
    rows = (f"{t:.6f},{np.sin(t):.6f}\n" for t in time)
    path.write_text("time_s,force_N\n" + "".join(rows))
    return path


def test_every_file_is_described(tmp_path):
    path = written(tmp_path, "chirp.csv")
    described = check_recordings([planned(path, period_s=1.0)])["tissue"]
    assert described == [
        {
            "file": "chirp.csv",
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "reader": "columns",
            "name": "chirp",
            "samples": 200,
            "rate_Hz": 100.0,
            "duration_s": 2.0,
            "channels": {"output": {"quantity": "force", "unit": "N"}},
        }
    ]


def test_all_problems_of_all_files_are_told(tmp_path):
    good, broken, short = (written(tmp_path, f"{name}.csv") for name in ("good", "broken", "short"))
    broken.write_text(broken.read_text().replace("0.030000", "abc"))
    short.write_text("time_s,force_N\n0,1\n")
    plan = [planned(good), planned(broken), planned(short), planned(tmp_path / "absent.csv")]
    with pytest.raises(InputError) as caught:
        check_recordings(plan)
    message = str(caught.value)
    assert message.startswith("recordings: 3 problems")
    for words in ("broken.csv", "line 5: time is 'abc'", "short.csv", "absent.csv: no such file"):
        assert words in message


def test_units_agree_within_a_set_only(tmp_path):
    a, b = written(tmp_path, "a.csv"), written(tmp_path, "b.csv")
    other = {
        "columns": LAYOUT["columns"] | {"output": {"column": "force_N", "quantity": "force", "unit": "kN"}}
    }
    with pytest.raises(InputError, match="force in kN, but force in N in a"):
        check_recordings([planned(a), planned(b, layout=other)])
    described = check_recordings([planned(a), planned(b, layout=other, chapter="surgeon", set="surgeon")])
    assert sorted(described) == ["surgeon", "tissue"]


def test_a_rate_that_cannot_be_reached_is_found_here(tmp_path):
    with pytest.raises(InputError, match="simpler ratio"):
        check_recordings([planned(written(tmp_path, "a.csv"), rate_Hz=0.01)])


def test_answers_and_markers_have_readers_of_their_own(tmp_path, project):
    layout = plain(SurveySettings().layout)
    path = project / "resources" / "survey" / "survey_reconstructed.csv"
    entry = {"chapter": "survey", "reader": "ratings", "path": str(path), "layout": layout}
    described = check_recordings([entry])["survey"][0]
    assert described["participants"] == 45
    assert described["sources"] == ["reconstructed_not_real"]
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(b"")
    markers = {
        "chapter": "lifting",
        "reader": "markers",
        "path": str(broken),
        "layout": {"aliases": {"C7": ["C7"]}},
    }
    with pytest.raises(InputError, match=r"broken\.c3d"):
        check_recordings([markers])
