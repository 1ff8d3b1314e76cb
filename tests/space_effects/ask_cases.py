"""Diagnose the labelled cases in three axes and judge every answer: a line per case, then how many intervals hold the truth.

    python tests/space_effects/ask_cases.py [--only coulomb,frame] [--seeds 1,2]

Ends with status 1 where an answer is not among those that are right.
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
from lumbar.tissue.diagnosis.selection.diagnose import diagnose  # noqa: E402
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult  # noqa: E402
from space_records import record_of  # noqa: E402

FINDINGS = {"frame": "turned_frame", "crosstalk": "crosstalk"}
SYMBOLS = {"K_e": "k_e", "K_1": "k_b", "B": "b", "tau_s": "tau"}
"""Of the base's parameters, by those of the truth."""


@dataclass(frozen=True)
class Answer:
    """What was told of one case."""

    result: DiagnosisResult
    named: frozenset[str]
    """Effects of the tissue; ``contact_plane`` for a base that meets one."""
    findings: frozenset[str]

    @property
    def words(self) -> str:
        """In a line."""
        base = self.result.model.fit.structure.base.name
        return f"{self.result.status}, {base}, {'+'.join(sorted(self.named)) or '-'}, {'+'.join(sorted(self.findings)) or '-'}"


SETTINGS = DiagnosisSettings(train="multisine")


def records_of(name: str, seed: int) -> tuple[list[Record], dict]:
    """Records of a case; its truth comes second."""
    made, truth = make_with_truth(name, seed)
    records = [
        record_of(key, table[:, 0], *np.split(table[:, 1:].T, 2), axis_names(CASES[name]))
        for key, table in made.items()
    ]
    return records, truth


def ask(name: str, seed: int) -> tuple[Answer, dict]:
    """Diagnose a case; its truth comes second."""
    records, truth = records_of(name, seed)
    result = diagnose(records, SETTINGS)
    findings = frozenset(item.kind for item in result.findings)
    contact = {"contact_plane"} if result.model.fit.structure.base.contact else set()
    return Answer(result, frozenset(result.selected) - {*FINDINGS.values()} | contact, findings), truth


def is_right(expected: list[dict], answer: Answer) -> bool:
    """Whether an answer is one of those that count as right."""
    return any(_agrees(item, answer) for item in expected)


def _agrees(expected: dict, answer: Answer) -> bool:
    wanted = frozenset(expected.get("named", ()))
    finding = expected.get("finding")
    told = FINDINGS[finding] in answer.findings if finding else not answer.findings & {*FINDINGS.values()}
    if "unexcited" in expected:
        told = told and "unexcited" in answer.findings
    if "tied" in expected:
        told = bool({FINDINGS[name] for name in expected["tied"]} & answer.findings) and bool(
            answer.result.tied_with
        )
    sound = answer.result.refined_status == "adequate" and answer.result.status != "unexplained"
    return bool(sound and told and wanted == answer.named)


def held(answer: Answer, truth: dict) -> list[tuple[str, bool]]:
    """Whether the interval of every parameter that the truth has holds it, and every turn of principal axes."""
    fit, experiment = answer.result.model.fit, answer.result.experiment
    known = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    structure = fit.structure
    symbols = [item.symbol for item in (*structure.linear, *structure.nonlinear)]
    found = {f"{item.effect}.{symbol}": item for item, symbol in zip(known, symbols, strict=True)}
    true = _numbers(truth)
    spatial = structure.base.spatial
    if not structure.base.contact:
        true |= _of_axes(spatial, fit, truth["tissue"])
    return [(key, found[key].low <= value <= found[key].high) for key, value in true.items() if key in found]


def _numbers(truth: dict) -> dict[str, float]:
    """Parameters of effects and the relaxation time, by effect and symbol."""
    found = {}
    for effect, numbers in truth["effects"].items():
        for symbol, value in numbers.items():
            values = np.atleast_1d(np.array(value, dtype=float))
            names = [symbol] if len(values) == 1 else [f"{symbol}_{axis}" for axis in "xyz"]
            found |= {f"{effect}.{name}": float(number) for name, number in zip(names, values, strict=False)}
    if "tau_s" in truth["tissue"]:
        found[".tau"] = truth["tissue"]["tau_s"]
    return found


def _of_axes(spatial, fit, tissue: dict) -> dict[str, float]:
    """Principal values in the order of the axes that were found, and how far these are turned from the true ones."""
    found: dict[str, float] = {}
    frames = spatial.frames_at(fit.nonlinear[: len(spatial.nonlinear)])
    several = len(frames) > 1
    matrices = [key for key in SYMBOLS if f"{key}_principal" in tissue]
    for number, key in enumerate(matrices):
        values, axes = np.array(tissue[f"{key}_principal"]), np.array(tissue[f"{key}_axes"])
        frame = frames[number if several else 0]
        if spatial.turns == 0:
            found[f".{SYMBOLS[key]}"] = float(values.mean())
            continue
        if spatial.turns == 2:
            odd = int(np.argmax([abs(values[i] - np.delete(values, i).mean()) for i in range(3)]))
            found |= {
                f".{SYMBOLS[key]}_along": values[odd],
                f".{SYMBOLS[key]}_across": np.delete(values, odd).mean(),
            }
            off = frame.T @ axes[:, odd] * np.sign(frame[:, 0] @ axes[:, odd])
            found |= {".r_1": -off[2], ".r_2": off[1]} if number == 0 else {}
            continue
        order = max(
            permutations(range(len(values))),
            key=lambda item: np.abs(np.sum(frame * axes[:, item], axis=0)).sum(),
        )
        signs = np.sign(np.sum(frame * axes[:, order], axis=0))
        off = frame.T @ (axes[:, order] * signs)
        found |= {f".{SYMBOLS[key]}_{place + 1}": values[at] for place, at in enumerate(order)}
        turns = [off[2, 1], off[0, 2], off[1, 0]] if len(values) == 3 else [off[1, 0]]
        if several or number == 0:
            owner = SYMBOLS[key] if several else ""
            found |= {f".r_{place + 1}{owner}": turn for place, turn in enumerate(turns)}
    # Turns are counted from the frame that is given, by little: those that were found belong to both.
    names = [item.symbol for item in spatial.nonlinear]
    return {
        key: value + (float(np.log(fit.nonlinear[names.index(key[1:])])) if key[1:3] == "r_" else 0.0)
        for key, value in found.items()
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
            within = held(answer, truth) if right else []
            outside = [key for key, inside in within if not inside]
            intervals += [inside for _, inside in within]
            wrong += not right
            print(
                f"{name} {seed} {'right' if right else 'WRONG'} | {answer.words} | {len(within)} intervals, outside: {outside}",
                flush=True,
            )
    print(
        f"{wrong} wrong; {sum(intervals)} of {len(intervals)} intervals hold the truth ({100 * np.mean(intervals):.1f} %)"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
