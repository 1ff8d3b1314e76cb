"""Plan a study after each of several changes: ``plan_changes.py FOLDER < changes.json`` prints the jobs of each plan.

All plans are made from one finished study. Its results are files without content; Snakemake has recorded how they were made.
Every call of Snakemake is a fork of this process, which has already imported what all of them need.
"""

import json
import os
import re
import sys
import tempfile
from pathlib import Path


def call(*arguments: str) -> str:
    """Return the output of Snakemake, which must succeed."""
    from snakemake.cli import main

    with tempfile.TemporaryFile("w+") as output:
        child = os.fork()
        if child == 0:
            os.dup2(output.fileno(), 1)
            os.dup2(output.fileno(), 2)
            try:
                main(["--cores", "1", "--nocolor", *arguments])
            except SystemExit as end:
                print(end.code, flush=True)
                os._exit(end.code not in (0, None))
        _, status = os.waitpid(child, 0)
        output.seek(0)
        text = output.read()
    if status:
        sys.exit(text)
    return text


DIAGNOSIS = {"base": "KB", "unit": "N", "verdict": "adequate", "complete": None, "selected": []}
DIAGNOSIS |= {"ladder": [{"test_rms": 1.0}]}
"""What the end of a run reads of a diagnosis."""


def finish_study() -> None:
    """Make every output of the default study, all but diagnoses as empty files, and let Snakemake record its rule."""
    for line in call("--summary").partition("output_file\t")[2].splitlines()[1:]:
        path = Path(line.split("\t")[0])
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(DIAGNOSIS) if path.name == "diagnosis.json" else "", encoding="utf-8")
    call("--touch", "--forceall")


def planned_jobs(*arguments: str) -> dict[str, int]:
    """Return the number of jobs of each rule that a dry run lists."""
    table = re.search(r"^job +count\n[- ]+\n(.*?)\ntotal ", call("--dry-run", *arguments), flags=re.M | re.S)
    rows = table[1].splitlines() if table else []
    return {row.split()[0]: int(row.split()[1]) for row in rows}


if __name__ == "__main__":
    os.chdir(sys.argv[1])
    sys.path.insert(0, "workflow")
    # What every call imports and computes.
    import pandas  # noqa: F401
    import snakemake.cli  # noqa: F401

    from lumbar.study.load_study import load_study_file
    from lumbar.twin import cohort  # noqa: F401
    from run.dependencies import library_code

    load_study_file(Path.cwd())
    for script in Path("workflow/scripts").glob("*.py"):
        library_code(script.name)
    finish_study()
    plans = {"nothing": planned_jobs()}
    for name, change in json.load(sys.stdin).items():
        path = Path(change["file"])
        before = path.read_text(encoding="utf-8") if path.exists() else None
        path.write_text(change["text"], encoding="utf-8")
        plans[name] = planned_jobs(*change["arguments"])
        path.unlink() if before is None else path.write_text(before, encoding="utf-8")
    json.dump(plans, sys.stdout)
