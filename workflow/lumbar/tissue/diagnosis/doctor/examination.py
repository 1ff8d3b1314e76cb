"""What could have been seen in a set of records: every effect and every mistake put into them and diagnosed blind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.doctor.effect_sizes import EffectSize, effect_sizes, forms_to_try
from lumbar.tissue.diagnosis.doctor.fault_telling import FaultTold, faults_told
from lumbar.tissue.diagnosis.doctor.faults import FAULTS, Fault
from lumbar.tissue.diagnosis.doctor.further_record import FurtherRecord, further_record, open_questions
from lumbar.tissue.diagnosis.doctor.outcome import Diagnose, Kind, Outcome, diagnosed, judge_effect
from lumbar.tissue.diagnosis.doctor.truth import Truth
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.effects.catalogue import choose, without_channels
from lumbar.tissue.models.form import Effect
from lumbar.tissue.signals.machine_limits import Kinematics

Track = Callable[[Iterator, str, int], Iterator]
"""Says how far a loop is: items, what they are, how many."""


@dataclass(frozen=True, eq=False)
class Examination:
    """What could have been seen."""

    truth: Truth
    nothing: Outcome
    """What was said of the records that the refined model would give, nothing put into them."""
    effects: tuple[EffectSize, ...]
    faults: tuple[FaultTold, ...]
    further: FurtherRecord | None


@dataclass(frozen=True)
class Scope:
    """What is put into the records."""

    effects: tuple[str, ...] | None = None
    """Names in the catalogue; None takes all."""
    faults: bool = True
    """Whether mistakes of a recording are tried too."""
    all_forms: bool = False
    """Every mathematical form of an effect instead of its first."""
    quick: bool = False
    """The prediction and one diagnosis that confirms it, in place of a search."""


def examine(
    records: Sequence[Record],
    verdict: Verdict,
    catalogue: dict[str, Effect],
    diagnose: Diagnose,
    scope: Scope,
    limits: Kinematics | None,
    seed: int,
    track: Track,
) -> Examination:
    """Put effects and mistakes into records, diagnose them blind, and seek the further record that helps most.

    Parameters
    ----------
    verdict : Verdict
        Their diagnosis.
    catalogue : dict of str to Effect
        Candidates of a diagnosis.
    diagnose : callable
        Blind diagnosis.
    limits : Kinematics, optional
        Of the machine that would play a further excitation, in the input's unit.
    seed : int
        Of noise and of what is random in a mistake.
    track : callable

    Raises
    ------
    InputError
        For an unknown effect, and for records of which the direction or a sign is wrong.
    """
    turned = next((item for item in verdict.findings if item.kind in ("direction", "sign")), None)
    if turned is not None:
        raise InputError(f"nothing can be put into these records: {turned.sentence}")
    truth = Truth.of(verdict, records, seed)
    usable, _ = without_channels(catalogue, truth.training.motion.channels)
    wanted = usable if scope.effects is None else _chosen(scope.effects, catalogue, usable)
    tried = forms_to_try(wanted, truth, scope.all_forms)
    mistakes = _mistakes(records, verdict) if scope.faults else []
    unchanged = diagnosed(truth.records(truth.fit), len(verdict.selected) + 1, diagnose)
    nothing = judge_effect(unchanged, "", verdict.selected, truth.fit.structure.base.name)

    def jobs() -> Iterator[EffectSize | FaultTold]:
        yield from effect_sizes(truth, usable, tried, diagnose, scope.quick)
        yield from faults_told(records, verdict, mistakes, diagnose, scope.quick, seed)

    done = list(track(jobs(), "effects and faults tried", len(tried) + len(mistakes)))
    sizes = tuple(item for item in done if isinstance(item, EffectSize))
    told = tuple(item for item in done if isinstance(item, FaultTold))
    return Examination(truth, nothing, sizes, told, further_record(truth, open_questions(sizes), limits))


def _chosen(
    names: tuple[str, ...], catalogue: dict[str, Effect], usable: dict[str, Effect]
) -> dict[str, Effect]:
    choose(list(names), catalogue)
    missing = [name for name in names if name not in usable]
    if missing:
        raise InputError(
            f"{', '.join(missing)}: needs channels that these records do not have; can be tried: {', '.join(usable)}"
        )
    return {name: usable[name] for name in dict.fromkeys(names)}


def _mistakes(records: Sequence[Record], verdict: Verdict) -> list[Fault]:
    """Mistakes that these records can have: a tissue's, and of one record only where there are others."""
    if verdict.base.fit.structure.base.system != "tissue":
        return []
    return [fault for fault in FAULTS.values() if len(records) > 1 or not fault.several]


def false_alarm(examination: Examination) -> bool:
    """Whether something was named where nothing had been put in."""
    return examination.nothing.kind is Kind.MISTAKEN
