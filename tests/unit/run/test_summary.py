"""What a run prints: its results in a few lines, warnings in groups, progress with the time left."""

import json
import logging
from types import SimpleNamespace

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from run.summary import grouped_warnings, summary
from snakemake_logger_plugin_lumbar import LogHandler


def write_diagnosis(results, name, errors, **changes):
    content = {
        "base": "KB",
        "unit": "N",
        "verdict": "named",
        "complete": True,
        "selected": ["coulomb_friction"],
        "headline": f"The model of {name}.",
        "ladder": [{"test_rms": error} for error in errors],
    }
    folder = results / "improvement" / name
    folder.mkdir(parents=True)
    (folder / "diagnosis.json").write_text(json.dumps(content | changes))


def test_results_begin_with_the_largest_fall_of_the_error(tmp_path):
    assert summary(tmp_path) == []
    write_diagnosis(tmp_path, "a_small", [1.44, 1.41])
    write_diagnosis(tmp_path, "b_clear", [0.397, 0.1, 0.015], selected=["coulomb_friction", "drift"])
    write_diagnosis(tmp_path, "c_right", [0.2], verdict="adequate", selected=[])
    (tmp_path / "claims.csv").write_text("verdict\nholds\ndoes not hold\nholds\n")
    (tmp_path / "runtime").mkdir()
    (tmp_path / "runtime" / "fmu_check.csv").write_text(
        "schema_problems,relative_error,tolerance,feedthrough\n0,1e-16,1e-12,one sample late\n0,1e-3,1e-12,none\n"
    )
    first, others, claims, fmus = summary(tmp_path)
    assert first == "b_clear: The model of b_clear."
    assert others == "a_small: named, error 1.44 to 1.41 N; c_right: adequate, error 0.2 N"
    assert claims == "3 claims of the thesis: does not hold 1, holds 2"
    assert fmus == "1 of 2 FMUs pass their checks; 1 in FMI 2.0 give the force one sample late"


def test_warnings_of_logs_have_one_line_each(tmp_path):
    first, second = tmp_path / "a.log", tmp_path / "b.log"
    first.write_text("begin\nWARNING: two gaps:\n  heel\n  toe\nend\n  not part of it\n")
    second.write_text("WARNING: one\n")
    assert grouped_warnings([str(first), str(tmp_path / "absent.log"), str(second)]) == [
        f"WARNING: two gaps, 2 more lines ({first})",
        f"WARNING: one ({second})",
    ]


@pytest.fixture
def log(capsys):
    """Return a function that sends records to the logger, and returns what it prints."""
    handler = LogHandler(SimpleNamespace(dryrun=False), None)

    def send(message="", level=logging.INFO, **fields):
        record = logging.LogRecord("snakemake", level, "", 0, message, (), None)
        record.__dict__.update(fields)
        handler.emit(record)
        return capsys.readouterr().err

    return send


def test_progress_has_few_lines_with_the_time_left(log):
    log(job_seconds=dict.fromkeys(range(100), 6.0))
    lines = [log("Building DAG of jobs...")]
    for number in range(100):
        lines.append(log(event=LogEvent.JOB_FINISHED, job_id=number))
        lines.append(log(event=LogEvent.PROGRESS, done=number + 1, total=100))
    printed = [line for line in lines if line]
    assert len(printed) == 9
    assert printed[0].startswith("10 of 100 jobs done, about 0 s left")


def test_errors_and_warnings_are_printed(log):
    log(job_seconds={1: 6.0})
    failed = log(level=logging.ERROR, event=LogEvent.JOB_ERROR, rule_name="a_rule", log=["a.log"])
    assert failed == "a_rule failed; its log: a.log\n"
    assert log("disk full", logging.ERROR) == "disk full\n"
    assert log("Nothing to be done (all requested files are present and up to date).")
