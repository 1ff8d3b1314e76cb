"""How good proposed laws are: on laws that are in no catalogue, and on records with nothing missing.

    python benchmarks/proposed_laws.py laws
    python benchmarks/proposed_laws.py nulls --count 120

*laws*: a law is looked for in three records; its error is then taken on three others that nothing has seen: the same amplitude
and speed, 1.5 times the amplitude, 1.5 times the speed. *nulls*: a true base with white, coloured or unknown noise; with
`--force` the search runs also where the base is found adequate.
"""

from __future__ import annotations

import argparse
import csv
import sys

import numpy as np
from scipy.signal import lfilter

from lumbar.interface.diagnose import diagnose
from lumbar.records.record import Channel, Record
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.law import proposal as law_proposal
from lumbar.tissue.diagnosis.law.terms import library
from lumbar.tissue.diagnosis.selection.candidate import evaluate
from lumbar.tissue.identification.metrics import settling_time
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure
from tissue_laws import LAWS, UNEVEN, motions, simulate, sines, swept

OVER_NOISE = 10.0
"""Error of the fitted base in noise levels."""


def record(name: str, time: np.ndarray, position: np.ndarray, force: np.ndarray) -> Record:
    """A record of a tissue test."""
    return Record(
        name, time, {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
    )


def error(fit, one: Record) -> float:
    """RMS of the free run on a record, from where it counts."""
    first = round(settling_time(one) / one.sampling_time)
    return float(np.sqrt(np.mean((fit.simulate(Motion.from_record(one)) - one["output"])[first:] ** 2)))


def law_row(name: str, make, seed: int = 0) -> dict:
    """Search one law and test the proposal on unused records."""
    random = np.random.default_rng(seed)
    clean = {one: simulate(make(), motion) for one, motion in motions().items()}
    alone = record("multisine", *clean["multisine"])
    base = diagnose_base([alone])
    noise = base / OVER_NOISE
    records = {
        one: record(one, time, position, force + noise * random.standard_normal(len(force)))
        for one, (time, position, force) in clean.items()
    }
    measured = [records[one] for one in ("multisine", "chirp", "noise")]
    diagnosis = diagnose(measured).propose().proposal
    row = {"law": name, "catalogue": "+".join(diagnosis.before.effects), "formula": "", "marked": ""}
    if diagnosis.law is not None:
        form = diagnosis.form
        row["formula"] = "; ".join([form.equation, *(f"{symbol}' = {rate}" for symbol, rate in form.state)])
        row["on"] = "+".join(["KB", *diagnosis.law.start.effects])
        row["marked"] = (
            ""
            if diagnosis.extrapolation is None
            else "holds"
            if diagnosis.extrapolation.holds
            else "does not"
        )
    else:
        row["formula"] = "; ".join(["none", *(refused for _, refused in diagnosis.tried)])
    for one in ("fresh", "larger", "faster"):
        row[f"{one}_before"] = round(error(diagnosis.before.fit, records[one]) / noise, 2)
        after = diagnosis.before.fit if diagnosis.law is None else diagnosis.law.fit
        row[f"{one}_after"] = round(error(after, records[one]) / noise, 2)
    return row


def diagnose_base(records: list[Record]) -> float:
    """Error of the base alone on the first record."""
    from lumbar.tissue.diagnosis.fitting.preparation import prepare

    experiment = prepare(records)
    return fit_base(Structure(BASES["KB"]), experiment.training).rms(experiment.training)


def null_records(random: np.random.Generator) -> list[Record]:
    """A tissue with nothing missing: white, coloured or unknown noise, of 2 to 20 % of the force."""
    lines = np.arange(1, 51) * 0.1 if random.random() < 0.7 else UNEVEN
    made = {
        "long": sines(random.choice([30, 40]), lines, random.integers(1e6), random.uniform(2, 8)),
        "chirp": swept(10, random.uniform(2, 6)),
        "noise": sines(10, UNEVEN, random.integers(1e6), random.uniform(2, 6)),
    }
    pole, share = random.choice([0.0, 0.0, 0.6]), random.uniform(0.02, 0.2)
    clean = {name: simulate(None, motion) for name, motion in made.items()}
    size = share * np.std(clean["long"][2])
    records = []
    for name, (time, position, force) in clean.items():
        white = random.standard_normal(len(force) + 200)
        noise = lfilter([np.sqrt(1 - pole**2)], [1, -pole], white)[200:]
        records.append(record(name, time, position, force + size * noise))
    return records


def null_proposes(seed: int, forced: bool) -> tuple[str, int]:
    """Formula proposed where nothing is missing (empty: none), and how many laws were tested."""
    from lumbar.tissue.diagnosis.fitting.preparation import prepare

    experiment = prepare(null_records(np.random.default_rng(seed)))
    base = evaluate(fit_base(Structure(BASES["KB"]), experiment.training), experiment)
    if forced:
        proposals = law_proposal.search_law(law_proposal.Proposal(experiment, base, base), library())
    else:
        proposals = law_proposal.propose(experiment, base)
    return (proposals.form.equation if proposals.law else ""), len(proposals.tried)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("laws", "nulls"))
    parser.add_argument("--like", default="", help="beginning of the names of the laws")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--force", action="store_true", help="search nulls also where the base is adequate")
    options = parser.parse_args(arguments)
    if options.what == "nulls":
        proposed = 0
        for seed in range(options.first, options.first + options.count):
            formula, tested = null_proposes(seed, options.force)
            proposed += bool(formula)
            print(seed, tested, formula or "-", flush=True)
        print(f"{proposed} proposals in {options.count} nulls")
        return
    rows = (law_row(name, make) for name, make in LAWS.items() if name.startswith(options.like))
    writer = None
    for row in rows:
        if writer is None:
            writer = csv.DictWriter(sys.stdout, [*row, *({"on"} - set(row))], restval="")
            writer.writeheader()
        writer.writerow(row)
        sys.stdout.flush()


if __name__ == "__main__":
    main()
