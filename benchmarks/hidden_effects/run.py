"""The benchmark of the diagnosis: experiments with a hidden effect are made, diagnosed blind, and scored.

    python benchmarks/hidden_effects/run.py            the whole benchmark: hundreds of effects, a thousand without any
    python benchmarks/hidden_effects/run.py --quick    one experiment of each form and pair

All results are in results/hidden_effects. A run continues an interrupted one, and a larger benchmark a smaller one, if neither
the ranges of the experiments nor the code has changed.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parents[1]
sys.path[:0] = [str(PROJECT / "workflow"), str(HERE.parent)]

from lumbar.base.environment import use_one_thread  # noqa: E402

use_one_thread()  # before numpy is imported

from hidden_effects.catalogue import MECHANISMS  # noqa: E402
from hidden_effects.experiment import plan_batch, write_experiments  # noqa: E402
from hidden_effects.settings import DRAWN, HiddenEffectsSettings  # noqa: E402
from lumbar.base.files import read_json, write_csv, write_json  # noqa: E402
from lumbar.tables.table import SYNTHETIC_TWIN  # noqa: E402
from run.dependencies import library_code  # noqa: E402

QUICK = HiddenEffectsSettings()
WHOLE = replace(
    QUICK,
    experiments_per_form=12,
    experiments_per_pair=5,
    experiments_per_outside_form=10,
    nulls=1000,
    nulls_per_batch=50,
    keep_recordings=False,
)
SCORING = ("run", "scores")
"""Modules that change no experiment and no diagnosis."""


@dataclass(frozen=True)
class Batch:
    """Experiments that one process makes and diagnoses; the truth stands apart from their recordings."""

    folder: Path
    """Folder of all results."""
    kind: str
    part: int

    @property
    def name(self) -> str:
        """Name of the folder and of both files."""
        return f"{self.kind}_{self.part:02d}"

    @property
    def recordings(self) -> Path:
        """Folder with one folder per experiment."""
        return self.folder / "experiments" / self.name

    @property
    def labels(self) -> Path:
        """The truth by experiment, which `publish` alone reads."""
        return self.folder / "labels" / f"{self.name}.json"

    @property
    def diagnoses(self) -> Path:
        """Diagnosis by experiment."""
        return self.folder / "diagnoses" / f"{self.name}.json"

    def done(self, settings: HiddenEffectsSettings) -> bool:
        """Return whether an earlier run has diagnosed the same experiments."""
        plans = plan_batch(self.kind, self.part, settings)
        return self.diagnoses.is_file() and read_json(self.diagnoses).keys() == {plan.name for plan in plans}


def batches(folder: Path, settings: HiddenEffectsSettings) -> list[Batch]:
    """List the batches of a benchmark."""
    parts = {
        "single": settings.experiments_per_form * settings.slices,
        "pair": settings.experiments_per_pair * settings.slices,
        "outside": settings.experiments_per_outside_form * settings.slices,
        "null": -(-settings.nulls // settings.nulls_per_batch),
    }
    return [Batch(folder, kind, part) for kind, count in parts.items() for part in range(count)]


def make_and_diagnose(batch: Batch, settings: HiddenEffectsSettings) -> None:
    """Make the recordings and, apart from them, the truth; diagnose the recordings; both files are there, or neither."""
    from hidden_effects.diagnosing import diagnose_folders

    shutil.rmtree(batch.recordings, ignore_errors=True)
    write_experiments(batch.recordings, batch.labels, plan_batch(batch.kind, batch.part, settings), settings)
    write_json(batch.diagnoses, diagnose_folders(batch.recordings))
    if not settings.keep_recordings:
        shutil.rmtree(batch.recordings)


def run(folder: Path, settings: HiddenEffectsSettings, processes: int) -> None:
    """Make and diagnose what is missing, then score everything."""
    begin_anew_if_changed(folder, settings)
    wanted = batches(folder, settings)
    missing = [batch for batch in wanted if not batch.done(settings)]
    print(f"{len(wanted) - len(missing)} of {len(wanted)} batches are there", flush=True)
    with ProcessPoolExecutor(processes) as pool:
        jobs = {pool.submit(make_and_diagnose, batch, settings): batch for batch in missing}
        for number, job in enumerate(as_completed(jobs), start=len(wanted) - len(missing) + 1):
            job.result()
            print(f"{jobs[job].name}: diagnosed, {number} of {len(wanted)}", flush=True)
    publish(folder, wanted, settings)


def begin_anew_if_changed(folder: Path, settings: HiddenEffectsSettings) -> None:
    """Remove what other ranges or other code made."""
    digest = hashlib.sha256(library_code(str(HERE / "diagnosing.py")).encode())
    digest.update(library_code(str(HERE / "experiment.py")).encode())
    for file in sorted(HERE.glob("*.py")):
        if file.stem not in SCORING:
            digest.update(file.read_bytes())
    drawn = {key: value for key, value in asdict(settings).items() if key in DRAWN}
    made_by = {"code": digest.hexdigest()[:16], "drawn": {key: repr(value) for key, value in drawn.items()}}
    stamp = folder / "made_by.json"
    if not stamp.is_file() or read_json(stamp) != made_by:
        for part in ("experiments", "labels", "diagnoses"):
            shutil.rmtree(folder / part, ignore_errors=True)
        write_json(stamp, made_by)


def publish(folder: Path, batches: list[Batch], settings: HiddenEffectsSettings) -> None:
    """Compare, count, publish: truth and diagnoses meet here and nowhere before."""
    from hidden_effects.scores import (
        accuracy_table,
        confusion,
        forms_table,
        scores,
    )

    labels, diagnoses = {}, {}
    for batch in batches:
        labels |= read_json(batch.labels)
        diagnoses |= read_json(batch.diagnoses)
    frame = scores(labels, diagnoses)
    write_csv(folder / "scores.csv", frame.assign(data=SYNTHETIC_TWIN))
    matrix = confusion(frame, list(MECHANISMS))
    write_csv(folder / "confusion.csv", matrix.assign(data=SYNTHETIC_TWIN))
    accuracy_table(frame, settings).write(folder / "tables" / "accuracy")
    forms_table(frame, settings).write(folder / "tables" / "forms")
    print(accuracy_table(frame, settings).frame.to_string(index=False))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="one experiment of each form and pair, 20 nulls")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--keep-recordings", action="store_true", help="0.3 MB per experiment")
    parser.add_argument("--output", type=Path, default=PROJECT / "results" / "hidden_effects")
    options = parser.parse_args()
    settings = QUICK if options.quick else WHOLE
    if options.keep_recordings:
        settings = replace(settings, keep_recordings=True)
    run(options.output, settings, options.processes)


if __name__ == "__main__":
    main()
