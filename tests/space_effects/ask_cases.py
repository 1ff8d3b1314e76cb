"""Diagnose the labelled cases in three axes and judge every answer: a line per case, then the coverage of intervals.

    python tests/space_effects/ask_cases.py [--only coulomb,frame] [--seeds 1,2]

The exit status is 1 if an answer is wrong.
"""

import argparse
import sys
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "workflow"), str(HERE.parent), str(HERE)]

import numpy as np  # noqa: E402
from make_cases import CASES, axis_names, make_with_truth  # noqa: E402

from lumbar.records.record import Record  # noqa: E402
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings  # noqa: E402
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates  # noqa: E402
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult  # noqa: E402
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose  # noqa: E402
from space_records import record_of  # noqa: E402

FINDINGS = {"frame": "turned_frame", "crosstalk": "crosstalk"}
SYMBOLS = {"K_e": "k_e", "K_1": "k_b", "B": "b", "tau_s": "tau"}
"""Symbols of the base's parameters by those of the truth."""
SETTINGS = DiagnosisSettings(train="multisine")


@dataclass(frozen=True)
class Answer:
    """Answer to one case."""

    result: DiagnosisResult
    named: frozenset[str]
    """Effects of the tissue, and ``contact_plane`` for a base with contact."""
    findings: frozenset[str]

    @property
    def summary(self) -> str:
        """The answer in a line."""
        base = self.result.model.fit.structure.base.name
        return f"{self.result.status}, {base}, {'+'.join(sorted(self.named)) or '-'}, {'+'.join(sorted(self.findings)) or '-'}"


def records_of(name: str, seed: int) -> tuple[list[Record], dict]:
    """Return the records of a case and its truth."""
    tables, truth = make_with_truth(name, seed)
    records = [
        record_of(key, table[:, 0], *np.split(table[:, 1:].T, 2), axis_names(CASES[name]))
        for key, table in tables.items()
    ]
    return records, truth


def ask(name: str, seed: int) -> tuple[Answer, dict]:
    """Diagnose a case; return the answer and the truth."""
    records, truth = records_of(name, seed)
    result = diagnose(records, SETTINGS)
    findings = frozenset(item.kind for item in result.findings)
    contact = {"contact_plane"} if result.model.fit.structure.base.contact else set()
    return Answer(result, frozenset(result.selected) - {*FINDINGS.values()} | contact, findings), truth


def is_right(expected: list[dict], answer: Answer) -> bool:
    """Return whether an answer is one of those that count as right."""
    if answer.result.refined_status != "adequate" or answer.result.status == "unexplained":
        return False
    return any(_agrees(item, answer) for item in expected)


def _agrees(expected: dict, answer: Answer) -> bool:
    sensor, finding = answer.findings & {*FINDINGS.values()}, expected.get("finding")
    if "tied" in expected:
        agrees = bool({FINDINGS[name] for name in expected["tied"]} & sensor and answer.result.tied_with)
    else:
        agrees = FINDINGS[finding] in sensor if finding else not sensor
    if "unexcited" in expected:
        agrees = agrees and "unexcited" in answer.findings
    return agrees and frozenset(expected.get("named", ())) == answer.named


def interval_checks(answer: Answer, truth: dict) -> list[tuple[str, bool]]:
    """Return whether the interval of every known parameter and of every rotation of principal axes contains the truth."""
    fit, experiment = answer.result.model.fit, answer.result.experiment
    known = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    structure = fit.structure
    symbols = [item.symbol for item in (*structure.linear, *structure.nonlinear)]
    estimated = {f"{item.effect}.{symbol}": item for item, symbol in zip(known, symbols, strict=True)}
    true = _true_parameters(truth)
    if not structure.base.contact:
        true |= _true_axes(structure.base.spatial, fit, truth["tissue"])
    return [
        (key, estimated[key].low <= value <= estimated[key].high)
        for key, value in true.items()
        if key in estimated
    ]


def _true_parameters(truth: dict) -> dict[str, float]:
    """Return the parameters of effects and the relaxation time, by effect and symbol."""
    parameters = {}
    for effect, numbers in truth["effects"].items():
        for symbol, value in numbers.items():
            values = np.atleast_1d(np.array(value, dtype=float))
            names = [symbol] if len(values) == 1 else [f"{symbol}_{axis}" for axis in "xyz"]
            parameters |= {
                f"{effect}.{name}": float(number) for name, number in zip(names, values, strict=False)
            }
    if "tau_s" in truth["tissue"]:
        parameters[".tau"] = truth["tissue"]["tau_s"]
    return parameters


def _true_axes(spatial, fit, tissue: dict) -> dict[str, float]:
    """Return the principal values in the order of the fitted axes, and the rotations of these from the true axes."""
    true: dict[str, float] = {}
    frames = spatial.frames_at(fit.nonlinear[: len(spatial.nonlinear)])
    several = len(frames) > 1
    matrices = [key for key in SYMBOLS if f"{key}_principal" in tissue]
    for number, key in enumerate(matrices):
        values, axes = np.array(tissue[f"{key}_principal"]), np.array(tissue[f"{key}_axes"])
        symbol, frame = f".{SYMBOLS[key]}", frames[number if several else 0]
        if spatial.turns == 0:
            true[symbol] = float(values.mean())
        elif spatial.turns == 2:
            odd = int(np.argmax([abs(values[i] - np.delete(values, i).mean()) for i in range(3)]))
            true |= {f"{symbol}_along": values[odd], f"{symbol}_across": np.delete(values, odd).mean()}
            rotation = frame.T @ axes[:, odd] * np.sign(frame[:, 0] @ axes[:, odd])
            true |= {".r_1": -rotation[2], ".r_2": rotation[1]} if number == 0 else {}
        else:
            order = max(
                permutations(range(len(values))),
                key=lambda item: np.abs(np.sum(frame * axes[:, item], axis=0)).sum(),
            )
            signs = np.sign(np.sum(frame * axes[:, order], axis=0))
            rotation = frame.T @ (axes[:, order] * signs)
            true |= {f"{symbol}_{place + 1}": values[index] for place, index in enumerate(order)}
            angles = (
                [rotation[2, 1], rotation[0, 2], rotation[1, 0]] if len(values) == 3 else [rotation[1, 0]]
            )
            if several or number == 0:
                owner = SYMBOLS[key] if several else ""
                true |= {f".r_{place + 1}{owner}": angle for place, angle in enumerate(angles)}
    # Small rotations add up: the fitted ones are from the given frame to the fitted one.
    names = [item.symbol for item in spatial.nonlinear]
    return {
        key: value + (float(np.log(fit.nonlinear[names.index(key[1:])])) if key[1:3] == "r_" else 0.0)
        for key, value in true.items()
    }


def main() -> int:
    """Run the cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--seeds", default="1")
    options = parser.parse_args()
    wrong, intervals = 0, []
    for seed in map(int, options.seeds.split(",")):
        for name in options.only.split(","):
            answer, truth = ask(name, seed)
            right = is_right(CASES[name]["expected"], answer)
            within = interval_checks(answer, truth) if right else []
            outside = [key for key, inside in within if not inside]
            intervals += [inside for _, inside in within]
            wrong += not right
            print(
                f"{name} {seed} {'right' if right else 'WRONG'} | {answer.summary} | {len(within)} intervals, outside: {outside}",
                flush=True,
            )
    print(
        f"{wrong} wrong; {sum(intervals)} of {len(intervals)} intervals contain the truth ({100 * np.mean(intervals):.1f} %)"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
