"""Faults of YAML files are told with file and line, and together with wrong keys."""

from __future__ import annotations

import subprocess
import sys

import pytest
import yaml

from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.study.load_study import load_study
from running import PROJECT


def problems_of(path, content: bytes) -> list[str]:
    path.write_bytes(content)
    problems = Problems("x")
    read_yaml(path, problems, "a.yaml")
    return problems.entries


def test_content_and_lines(tmp_path):
    text = "a: 1\nb:\n  c: [x, {d: 2}]\n  e: &e {f: 3}\ng:\n  <<: *e\n  h: 1.5e+3\n"
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    problems = Problems("x")
    file = read_yaml(tmp_path / "a.yaml", problems)
    assert not problems.entries
    assert file.content == yaml.safe_load(text)
    assert (file.lines["b", "c", 1, "d"], file.lines["b", "e", "f"], file.lines["g", "h"]) == (3, 4, 7)
    assert file.line(("b", "c", 7, "z")) == 3
    assert read_yaml(tmp_path / "a.yaml", problems).path.endswith("a.yaml")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a: [1, 2\nb: 3\n", "a.yaml, line 2: not valid YAML: while parsing a flow sequence"),
        (b"a: 1\n\tb: 2\n", "a.yaml, line 2: not valid YAML: while scanning"),
        (b"a: 1\nb: *c\n", "a.yaml, line 2: not valid YAML: found undefined alias"),
        (
            b"a: !!python/object/apply:os.system [ls]\n",
            "a.yaml, line 1: a: tag 'tag:yaml.org,2002:python/object",
        ),
        (b"b: !!python/name:os.system x\n", "a.yaml, line 1: b: could not determine a constructor"),
        (b"a: 1\n---\nb: 2\n", "not valid YAML"),
        (
            "a: 1\nb: Prüfstand\n".encode("latin-1"),
            "a.yaml, line 2: byte 0xfc is not UTF-8; save the file in",
        ),
        (b"a: 1\nb: {c: 2,\n  c: 3}\na: 4\n", "a.yaml, lines 1 and 4: key 'a' stands twice; keep one"),
        (b"a: 1\nb: {c: 2,\n  c: 3}\na: 4\n", "a.yaml, lines 2 and 3: key 'b.c' stands twice"),
        (b"a: {b: 1, b: 2}\n", "a.yaml, lines 1 and 1: key 'a.b' stands twice"),
        (b"- 1\n", "a.yaml: no mapping"),
        (b"a: " + b"[" * 3000 + b"]" * 3000, "a.yaml: nested too deep"),
        (
            b"b: 1\na: " + b"9" * 200,
            "a.yaml, line 2: a: a number of 200 digits; numbers have at most 100 digits",
        ),
        (b"a: " + b"9" * 5000, "a.yaml, line 1: a: a number of 5000 digits; numbers have at most 100 digits"),
        (b"a: &a [x, x, x, x, x, x, x, x, x, x]\n", ""),
        (
            b"a: &a [x, x, x, x, x, x, x, x, x]\n"
            + b"".join(
                b"%c: &%c [%s]\n" % (k, k, b", ".join([b"*%c" % (k - 1)] * 9)) for k in range(98, 106)
            ),
            "a.yaml: nested too deep, or aliases of aliases; at most",
        ),
        (b"a: " + b"x" * 1_100_000, "at most 1000000 are read"),
    ],
)
def test_faults(tmp_path, content, words):
    found = problems_of(tmp_path / "a.yaml", content)
    assert bool(found) == bool(words)
    assert words in " ".join(found)


def test_an_absent_file(tmp_path):
    problems = Problems("x")
    assert read_yaml(tmp_path / "absent.yaml", problems).content == {}
    assert "absent.yaml: no such file" in problems.entries[0]


def test_messages_name_the_file_that_said_it_last(tmp_path):
    upper = tmp_path / "upper.yaml"
    upper.write_text("title: x\nsurvey:\n  confidence: 95\n  zeros: pratt\n  zeros: wilcox\nseed: 5\n")
    lower = tmp_path / "lower.yaml"
    lower.write_text("chapters: [survey]\nsurvey: {confidence: 0.9, resamples: 3}\n")
    config = {
        "title": "x",
        "chapters": ["survey"],
        "survey": {"confidence": 95, "zeros": "wilcox", "resamples": 3},
        "seed": -5,
    }
    with pytest.raises(InputError) as caught:
        load_study(config, PROJECT, [lower, upper])
    message = str(caught.value)
    assert f"{upper}, line 3: survey.confidence: found 95" in message
    assert f"{lower}, line 2: survey.resamples: found 3" in message
    assert f"{upper}, lines 4 and 5: key 'survey.zeros' stands twice" in message
    assert "--config: seed: found -5" in message
    assert "4 problems" in message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("title: Pr\xfcfung\n", "study.yaml, line 1: byte 0xfc is not UTF-8; save the file"),
        ("title: x\nsurvey: [\n", "study.yaml, line 3: not valid YAML: while parsing a flow node"),
        ("title: x\n", ""),
    ],
)
def test_a_study_is_read_before_snakemake_reads_it(tmp_path, content, words):
    """As ``make`` does: nothing of the workflow runs before Snakemake has read its ``--configfile``."""
    path = tmp_path / "study.yaml"
    path.write_text(content, encoding="latin-1")
    command = [sys.executable, "-m", "lumbar.base.yaml_file", str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == bool(words)
    assert words in run.stderr and "Traceback" not in run.stderr
