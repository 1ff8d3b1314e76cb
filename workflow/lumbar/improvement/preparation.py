"""From validated records to data for fitting: training and test records, noise floor, whitening."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lumbar.effects.motion import Motion
from lumbar.errors import InputError
from lumbar.improvement.excitation_checks import check_excitation, check_response
from lumbar.improvement.fitting import SETTLING, FitData
from lumbar.improvement.noise_floor import NoiseFloor, noise_floor
from lumbar.records.record import Record, same_units

_HELD_BACK = 0.3
"""Share of a single record that is held back as test where there is no other record."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A set of records ready for diagnosis.

    Attributes
    ----------
    training : FitData
    tests : list of FitData
        Unseen excitation; the last part of the training record where there is no other record.
    floor : NoiseFloor or None
        None where no record repeats.
    input_unit, output_unit : str
    input_offset, output_offset : float
        What was taken off the training record's channels; 0 where records are taken as they are.
    """

    training: FitData
    tests: list[FitData]
    floor: NoiseFloor | None
    input_unit: str
    output_unit: str
    input_offset: float = 0.0
    output_offset: float = 0.0


def prepare(
    records: list[Record],
    train: str | None = None,
    periods: dict[str, float] | None = None,
    centre: bool = False,
) -> Experiment:
    """Choose the training record, estimate its noise and prepare all records.

    Parameters
    ----------
    records : list of Record
        With channels ``input`` and ``output``.
    train : str, optional
        Name of the training record; default the longest.
    periods : dict of str to float, optional
        Period of a record's excitation in seconds; default found from the input.
    centre : bool
        Take each record's means off input and output: for sensors whose zero is arbitrary.

    Returns
    -------
    Experiment

    Raises
    ------
    InputError
        No or unknown records, different units, or a record shorter than what is left out for settling.
    """
    if not records:
        raise InputError("no records to diagnose")
    same_units(records)
    names = [record.name for record in records]
    for name in [*(periods or {}), *([train] if train else [])]:
        if name not in names:
            raise InputError(f"no record {name!r}; there are {', '.join(names)}")
    chosen = next((item for item in records if item.name == train), max(records, key=len))
    for record in records:
        if record.duration < 2 * SETTLING + 50 * record.sampling_time:
            raise InputError(
                f"{record.source or record.name}: {record.duration:g} s is too short: the first {SETTLING} s settle, "
                "and at least as much and 50 samples must follow"
            )
    check_excitation(chosen, [record for record in records if record is not chosen])
    # A study's own period of a record with fewer than three of them says nothing about noise; one that is asked for
    # here and cannot be used is an error.
    known = chosen.period if chosen.period and chosen.duration >= 3 * chosen.period else None
    floor = noise_floor(replace(chosen, period=known), (periods or {}).get(chosen.name))
    check_response(chosen, floor)
    training, tests = _split(chosen, [item for item in records if item is not chosen])
    whitening = np.ones(1) if floor is None else floor.whitening
    return Experiment(
        _fit_data(training, centre, whitening),
        [_fit_data(item, centre, _at_rate(whitening, item, training)) for item in tests],
        floor,
        chosen.channels["input"].unit,
        chosen.channels["output"].unit,
        float(np.mean(training["input"])) if centre else 0.0,
        float(np.mean(training["output"])) if centre else 0.0,
    )


def _at_rate(whitening: np.ndarray, record: Record, training: Record) -> np.ndarray:
    """Whitening filter for a record: the training record's, where both are sampled alike."""
    return whitening if np.isclose(record.sampling_time, training.sampling_time) else np.ones(1)


def _fit_data(record: Record, centre: bool, whitening: np.ndarray) -> FitData:
    offset, level = (float(record[role].mean()) if centre else 0.0 for role in ("input", "output"))
    motion, force = Motion.of(record, offset=offset), record["output"] - level
    return FitData(record.name, motion, force, whitening)


def _split(chosen: Record, others: list[Record]) -> tuple[Record, list[Record]]:
    if others:
        return chosen, others
    cut = chosen.time[0] + (1 - _HELD_BACK) * chosen.duration
    return chosen.between(chosen.time[0], cut), [chosen.between(cut, np.inf)]
