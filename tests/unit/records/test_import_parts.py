"""One file cut into named records: by spans of its clock, or by a column that names or numbers the trial."""

import json

import numpy as np
import pytest
from foreign_files import FORCE, POSITION, RATE, TIME, rows

import lumbar
from lumbar.base.errors import InputError
from refusing import refusal

HEAD = "time_s,position_mm,force_N\n"


@pytest.fixture
def source(tmp_path):
    """Return the path of a recording of 3 s."""
    path = tmp_path / "bench.csv"
    path.write_text(HEAD + rows(","))
    return path


def trials(path, labels, time=TIME, head="time_s,position_mm,force_N,trial\n"):
    """Write the recording with a column more."""
    lines = rows(",", columns=(time, POSITION, FORCE)).splitlines()
    path.write_text(head + "".join(f"{line},{label}\n" for line, label in zip(lines, labels, strict=True)))
    return path


def test_spans_become_records_of_their_names(run, source, tmp_path):
    cuts = ("--cut", "fit=:1", "--cut", "unseen=1:2.5")
    out = run.done("import", source, *cuts, "--output", tmp_path / "records")
    assert "200 of 600 samples: --cut fit=:1" in out
    records = lumbar.read(tmp_path / "records")
    assert records.names == ["fit", "unseen"]
    np.testing.assert_allclose(records["fit"]["output"], FORCE[:200], atol=2e-5)
    np.testing.assert_allclose(records["unseen"]["input"], POSITION[200:500], atol=2e-5)
    assert records["unseen"].time[0] == 1
    entries = json.loads((tmp_path / "records/imported.json").read_text())["records"]
    assert [entry["notes"][0] for entry in entries] == [
        "200 of 600 samples: --cut fit=:1",
        "300 of 600 samples: --cut unseen=1:2.5",
    ]


def test_wrong_parts_are_told_of_at_once(run, source):
    cuts = ("fit=0:1", "unseen=0.5:2", "late=10:20", "../up=2:2.5", "fit=2.5:2.6", "back=2.9:2.7")
    status, out, err = run("import", source, *(word for cut in cuts for word in ("--cut", cut)), "--dry-run")
    assert (status, out) == (1, "")
    for words in (
        "fit and unseen share 0.5 to 1 s",
        "--cut late=10:20: 0 samples from 10 to 20 s; the clock runs from 0 to 2.995 s",
        "'../up' names no record; letters, digits, _, . and - are allowed",
        "2 parts are named 'fit'",
        "--cut back=2.9:2.7: the start must lie before the stop",
    ):
        assert words in err
    assert "5 problems" in err


def test_what_is_wrong_in_every_part_is_told_with_a_span_that_helps(tmp_path):
    force = FORCE.copy()
    force[[100, 400]] = np.nan
    (tmp_path / "a.csv").write_text(HEAD + rows(",", columns=(TIME, POSITION, force)))
    cut = [("fit", (0, 1)), ("unseen", (1, 3))]
    told = refusal(lumbar.import_recordings, tmp_path / "a.csv", cut=cut)
    assert "fit: " in told
    assert "line 102: force is missing in 1 samples" in told
    assert "line 402: force is missing in 1 samples" in told
    assert "--cut fit=0:0.4975" in told
    assert "--trim" not in told
    [part] = lumbar.import_recordings(tmp_path / "a.csv", cut=[("fit", (0, 0.4975))])
    assert len(part.record) == 100


def test_parts_are_of_one_file_and_said_in_one_way(run, source, tmp_path):
    other = tmp_path / "other.csv"
    other.write_bytes(source.read_bytes())
    err = run.refused("import", source, other, "--cut", "fit=0:1", "--dry-run")
    assert "--cut parts one file, and 2 are given" in err
    for told in (("--trim", "0:2"), ("--cut-by", "time")):
        err = run.refused("import", source, "--cut", "fit=0:1", *told, "--dry-run")
        assert "give one of --cut, --cut-by and --trim" in err
    status, _, err = run("import", source, "--cut", "0:1", "--dry-run")
    assert status == 2
    assert "NAME=START:STOP is needed, e.g. fit=0:60" in err


def test_a_column_numbers_the_trials(tmp_path):
    """The clock of each may begin anew."""
    numbers = np.repeat([1, 2, 3], 200)
    path = trials(tmp_path / "bench.csv", numbers, time=np.tile(TIME[:200], 3))
    imported = lumbar.import_recordings(path, cut_by="trial")
    assert imported.records.names == ["bench_1", "bench_2", "bench_3"]
    for number, one in enumerate(imported):
        assert one.record.time == pytest.approx(TIME[:200])
        assert one.record["output"] == pytest.approx(FORCE[200 * number :][:200], abs=2e-5)
        assert one.notes[0] == f"200 of 600 samples: column 4 'trial' is {number + 1}"


def test_a_column_names_the_trials(tmp_path):
    names = ["slow"] * 200 + [""] * 50 + ["fast sine"] * 250 + ["slow"] * 100
    path = trials(tmp_path / "bench.csv", names)
    imported = lumbar.import_recordings(path, cut_by=4)
    assert imported.records.names == ["bench_slow", "bench_fast_sine", "bench_slow_2"]
    assert [len(one.record) for one in imported] == [200, 250, 100]
    assert 1 / imported[1].record.sampling_time == pytest.approx(RATE)


def test_words_that_no_name_holds_are_numbered(tmp_path):
    path = trials(tmp_path / "bench.csv", ["慢"] * 300 + ["快"] * 300)
    imported = lumbar.import_recordings(path, cut_by="trial")
    assert imported.records.names == ["bench_1", "bench_2"]
    assert imported[1].notes[0] == "300 of 600 samples: column 4 'trial' is 快"


def test_trials_that_are_none(tmp_path):
    path = trials(tmp_path / "bench.csv", np.repeat([1, 2, 3], [300, 295, 5]))
    with pytest.raises(InputError, match=r"bench_3: 5 samples; at least 8 are needed"):
        lumbar.import_recordings(path, cut_by="trial")
    with pytest.raises(InputError, match=r"--cut-by 'cycle': no such column; there are .*column 4 'trial'"):
        lumbar.import_recordings(path, cut_by="cycle")
    with pytest.raises(InputError, match=r"--cut-by: column 1 'time' .* has 600 stretches of one value"):
        lumbar.import_recordings(path, cut_by="time")
