"""From validated records to data for fitting: training and test records, sessions, checks, noise floor, whitening."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Self

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record, require_clock, require_one_axis, require_same_units
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor, noise_floor
from lumbar.tissue.diagnosis.noise.periods import MIN_FULL_PERIODS, MIN_PERIODS, declared_period
from lumbar.tissue.diagnosis.sensors.sensor_faults import force_of_position_noise, repair
from lumbar.tissue.identification.metrics import settling_time
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.measured_motion import for_base
from lumbar.tissue.models.motion import Motion

_MOVED_ON = 0.5
"""Duration of the move between two records if their clocks show no pause, relative to the time scale of a record."""
_STEPS = 1.5
"""Largest step between two records, relative to those within: a larger one is a move that was not recorded."""
_LONGEST_PAUSE = 10.0
"""Durations of the whole session's records, beyond which a pause between two is a mistake of the clocks."""


def add_session_history(records: Sequence[Record]) -> dict[str, tuple[Record, int]]:
    """Return every record with all that came before it in the session, and the sample at which the record begins, by name.

    A pause between two records is taken from their clocks, if each begins after the end of the one before; else they follow
    immediately. Motion that was not recorded is filled in: the tool moves smoothly to the start of the next record, in the
    pause, or within half a time scale if it jumps. The force is filled in too, but excluded from every error.

    The records are in the order of the session, with the same channels.

    Raises
    ------
    InputError
        If they are not sampled alike, or a pause is longer than ten times all records together.
    """
    _check_alike(records)
    found: dict[str, tuple[Record, int]] = {}
    past: Record | None = None
    step = max(float(np.abs(np.diff(record["input"])).max()) for record in records)
    longest = _LONGEST_PAUSE * sum(record.duration for record in records)
    clocked = all(after.time[0] > before.time[-1] for before, after in pairwise(records))
    for index, record in enumerate(records):
        begins = 0
        if past is None:
            past = replace(record, time=np.arange(len(record)) * records[0].sampling_time)
        else:
            pause = float(record.time[0] - records[index - 1].time[-1]) if clocked else 0.0
            past, begins = _append(past, record, pause, step, longest)
        found[record.name] = (
            replace(past, name=record.name, source=record.source, period=record.period),
            begins,
        )
    return found


def simulate_in_session(
    records: Sequence[Record], simulate: Callable[[Record], np.ndarray]
) -> Callable[[Record], np.ndarray]:
    """A simulation of records that knows what came before each of them in the session."""
    known = add_session_history(records)

    def simulated(record: Record) -> np.ndarray:
        joined, begins = known[record.name]
        return simulate(joined)[begins:]

    return simulated


def check_equal_rates(records: Sequence[Record], together: str) -> None:
    """Refuse records with different sampling times; `together` says what they are."""
    first = records[0]
    for record in records[1:]:
        if not np.isclose(record.sampling_time, first.sampling_time, rtol=1e-6):
            raise InputError(
                f"{record.source or record.name}: sampled every {record.sampling_time:g} s, {first.name} every "
                f"{first.sampling_time:g} s; {together} must be sampled alike: give a rate (tissue.rate_Hz)"
            )


def _check_alike(records: Sequence[Record]) -> None:
    check_equal_rates(records, "records of one session")
    first = records[0]
    for record in records[1:]:
        if set(record.channels) != set(first.channels):
            raise InputError(
                f"{record.source or record.name}: has the channels {', '.join(record.channels)}, {first.name} "
                f"{', '.join(first.channels)}; records of one session need the same ones"
            )


def _append(past: Record, record: Record, pause: float, step: float, longest: float) -> tuple[Record, int]:
    """Append a record to those before it, with the move in between; return both and the sample at which it begins."""
    if pause > longest:
        raise InputError(
            f"{record.source or record.name}: begins {pause:g} s after the record before it ended, which is more than "
            f"{_LONGEST_PAUSE:g} times all records together; records of one session follow one another: correct the times, or "
            "leave session out"
        )
    between = max(round(pause / past.sampling_time) - 1, 0)
    if not between and abs(record["input"][0] - past["input"][-1]) > _STEPS * step:
        between = round(_MOVED_ON * past.time_scale / past.sampling_time)
    share = np.arange(1, between + 1) / (between + 1)
    way = share**2 * (3 - 2 * share)
    channels = {}
    for role, channel in past.channels.items():
        before, after = channel.values, record[role]
        filled = before[-1] + way * (after[0] - before[-1])
        channels[role] = replace(channel, values=np.concatenate([before, filled, after]))
    begins = len(past) + between
    time = np.arange(begins + len(record)) * past.sampling_time
    return replace(past, time=time, channels=channels, filled=()), begins


_UNIT_FACTOR = 200.0
"""Ratio of two records' force over position, in slow motion, that only another unit explains."""
_SLOWEST = 0.3
"""Share of the samples that count as slow: at high speed a force may grow beyond all measure."""
_LEAST_RANGE = 0.05
"""Share of another record's range that a training record must cover."""
_ABOVE_NOISE = 2.0
"""Variance of a response in noise variances, below which it holds little else."""
DWARFING = 3.0
"""Ratio of an error to the noise floor above which the model causes it."""
_BEGINNING, _TOGETHER = 100, 0.05
"""Part of the samples that is a record's beginning, and share of all records' reach within which these lie at one place."""
_FINE = 5
"""Decimals of a position at rest that tell, of the records' reach."""
_COPIED, _LOOKS = 64, 9
"""Number of equal samples in a row if one record contains part of another; number of places that are compared."""
_FEWEST = 50
"""Samples that must follow the start of a record which is left out."""
_HELD_BACK = 0.3
"""Share of a single record that is used as test if there is no other record."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A set of records ready for diagnosis."""

    training: FitData
    """Training data; `JointData` of several records that are fitted together."""
    tests: list[FitData]
    """Unseen records; the last part of the training record if there is no other."""
    floor: NoiseFloor | None
    """None where no record repeats."""
    input_unit: str
    output_unit: str
    floor_from: str
    """Name of the training record that the floor was taken from, or would have been."""
    input_quantity: str = "position"
    output_quantity: str = "force"
    rest: tuple[float, ...] = (0.0,)
    """Position along every axis from which those of a fastened tool are counted: 0, or that of `shift_to_rest`."""
    surface: float = 0.0
    """Position from which positions are counted, of one axis: that of a tissue's surface which the tool is not fastened to;
    else that of `rest`."""
    records: tuple[Record, ...] = ()
    """All records, faults of their sensors repaired."""
    faults: tuple[Finding, ...] = ()
    """Faults of the sensors."""
    session: bool = False
    """Whether each record begins in the state at the end of the one before."""
    settling_s: float | None = None
    """Seconds at the start of every record that no error counts; None follows the records (`settling_time`)."""
    position_noise_force: float = 0.0
    """RMS of the force that known noise of the position makes of a right model within the excitation's band, where no filter
    takes it off."""

    @classmethod
    def from_records(
        cls,
        records: Sequence[Record],
        settings: DiagnosisSettings,
        repaired: tuple[list[Record], list[Finding]] | None = None,
    ) -> Self:
        """Prepare records of one axis for a diagnosis.

        Faults of a tissue test's sensors are repaired, and its positions are counted from rest. `repaired` is the result of
        `repair`, if that is known.

        Raises
        ------
        InputError
            As `prepare`.
        """
        if settings.system != "tissue":
            seen = [for_base(record, BASES[settings.base]) for record in records]
            return cls.prepare_unrepaired(seen, settings, records=tuple(records))
        sound, faults = repaired or repair(records)
        force = force_of_position_noise(records, sound, faults)
        known = {"records": tuple(sound), "faults": tuple(faults), "position_noise_force": force}
        return cls.prepare_unrepaired(sound, settings, **known).shift_to_rest()

    @classmethod
    def prepare_unrepaired(cls, records: Sequence[Record], settings: DiagnosisSettings, /, **known) -> Self:
        """Prepare records as they are; `known` are further fields of the experiment."""
        return prepare(list(records), settings.train, settings.session, settings.settling_s, **known)

    @property
    def points(self) -> bool:
        """Whether these are points of a static test, without a clock."""
        return any(record.points for record in self.records)

    @property
    def size(self) -> int:
        """Samples of all records that count."""
        return self.training.size + sum(item.size for item in self.tests)

    @property
    def noise(self) -> float:
        """RMS of the noise floor; 0 where it is not known."""
        return 0.0 if self.floor is None else self.floor.rms

    @property
    def extra_floor_rms(self) -> float:
        """RMS error of a right model in addition to the floor: the force of known position noise, and drift that may be a
        wandering zero."""
        floor = self.floor
        drift = 0.0 if floor is None or floor.certain_structure_rms else floor.structured_rms
        return float(np.hypot(self.position_noise_force, drift))

    def shift_origin(self, surface: float, **fields) -> Self:
        """Return the same records, their positions counted from here; `fields` are other new values."""
        shift = surface - self.surface
        if not shift:
            return replace(self, **fields) if fields else self
        return self.each(lambda item: item.shift_origin(shift), surface=surface, **fields)

    def shift_to_rest(self) -> Self:
        """Return the same records, of one axis, their positions counted from `resting_position`."""
        records = (*self.training.records, *self.tests)
        rest = resting_position([item.drop_history(item.motion.position)[None] for item in records])
        return self.shift_origin(float(rest[0]), rest=tuple(rest))

    @property
    def has_own_zeros(self) -> bool:
        """Whether every record has a zero of the sensor, instead of one for all."""
        return all(item.has_own_zero for item in self.tests)

    def allow_own_zeros(self) -> Self:
        """Return the same records, each with its zero."""
        # A single record that is fitted has one zero anyway: what was fitted to it stays.
        is_joint, tests = (
            isinstance(self.training, JointData),
            [replace(item, has_own_zero=True) for item in self.tests],
        )
        return replace(
            self,
            training=replace(self.training, has_own_zero=True) if is_joint else self.training,
            tests=tests,
        )

    def drop_whitening(self) -> Self:
        """Return the same records without whitening of their errors."""
        return self.each(lambda item: item.drop_whitening())

    def change_data(self, change: Callable[[FitData], FitData], joint: type[JointData] = JointData) -> Self:
        """Return the same experiment with changed data of every record; `joint` is the class of joint data."""

        def changed(data: FitData) -> FitData:
            if isinstance(data, JointData):
                return replace(
                    joint.join([change(part) for part in data.parts]), has_own_zero=data.has_own_zero
                )
            return change(data)

        return self.each(changed)

    def each(self, change: Callable[[FitData], FitData], **fields) -> Self:
        """Return the same experiment with changed data of training and tests; `fields` are other new values."""
        tests = [change(item) for item in self.tests]
        return replace(self, training=change(self.training), tests=tests, **fields)

    def error_dwarfs_noise(self, train_rms: float) -> bool:
        """Return whether a model's error on the training record is so large that whitening by the noise's colour is wrong.

        Whitening is for errors that are noise. If the model's error dominates, it emphasises frequencies with little noise, and
        the simulation gets worse.
        """
        whitened = len(self.training.whitening) > 1
        return whitened and self.floor is not None and train_rms > DWARFING * self.floor.rms


def prepare(
    records: list[Record],
    /,
    train: str | Sequence[str] | None = None,
    session: bool = False,
    settling_s: float | None = None,
    **known,
) -> Experiment:
    """Choose the training records, estimate their noise and prepare all records.

    Parameters
    ----------
    records : list of Record
        With channels ``input`` and ``output``.
    train : str or sequence of str, optional
        Name of the training record, or of several that are fitted together; default the longest.
    session : bool
        Whether the records were cut from one session, in their order (`lumbar.tissue.diagnosis.fitting.preparation`).
    settling_s : float, optional
        Seconds at the start of every record that no error counts; default as `settling_time` finds them.
    known
        Further fields of the experiment.

    Raises
    ------
    InputError
        No or unknown records, different units, a record shorter than what is left out for settling, or training records
        that are not sampled alike.
    """
    require_clock(records)
    require_one_axis(records, "this")
    require_same_units(records)
    settling = {record.name: settling_samples(record, settling_s) for record in records}
    chosen, others = choose_training(records, train)
    check_excitation(max(chosen, key=lambda item: float(np.ptp(item["input"]))), others)
    check_unseen(chosen, others)
    first, floor = _noise_floor_of(chosen)
    check_response(first, floor)
    whitening = np.ones(1) if floor is None else floor.whitening
    past = add_session_history(records) if session else {}
    fitted = [_fit_data(item, whitening, settling, past) for item in chosen]
    alike = {item.name: np.isclose(item.sampling_time, first.sampling_time) for item in others}
    tests = [
        _fit_data(item, whitening if alike[item.name] else np.ones(1), settling, past) for item in others
    ]
    return assemble_experiment(first, fitted, tests, floor, session=session, settling_s=settling_s, **known)


def resting_position(positions: Sequence[np.ndarray]) -> np.ndarray:
    """Position from which records are counted, by axis: 0, unless no record comes as near to it as all of them reach.

    A machine counts from its frame, a robot from its foot: nothing that a tissue does depends on where that is. Then it is where
    all records begin to move, or, where they do not begin at one place, the mean of the first.

    Parameters
    ----------
    positions : sequence of ndarray
        Of every record, shape (axes, samples); the first is that of training.
    """
    every = np.concatenate(positions, axis=1)
    reach = float(np.linalg.norm(np.ptp(every, axis=1)))
    if np.linalg.norm(every, axis=0).min() <= reach:
        return np.zeros(len(every))
    begins = np.concatenate([item[:, : 1 + item.shape[1] // _BEGINNING] for item in positions], axis=1)
    together = np.linalg.norm(np.ptp(begins, axis=1)) <= _TOGETHER * reach
    rest = (begins if together else positions[0]).mean(axis=1)
    return np.round(rest, max(0, int(np.ceil(_FINE - np.log10(reach)))))


def choose_training(
    records: list[Record], train: str | Sequence[str] | None
) -> tuple[list[Record], list[Record]]:
    """Training records by name, default the longest, and the others."""
    if not records:
        raise InputError("no records to diagnose")
    names = [record.name for record in records]
    wanted = [train] if isinstance(train, str) else list(train or [])
    for name in wanted:
        if name not in names:
            raise InputError(f"no record {name!r}; there are {', '.join(names)}")
    chosen = [item for item in records if item.name in wanted] or [max(records, key=len)]
    check_equal_rates(chosen, "records that are fitted together")
    return chosen, [item for item in records if all(item is not one for one in chosen)]


def settling_samples(record: Record, settling_s: float | None) -> int:
    """Samples at the start of a record that no error counts, where enough follow."""
    time = settling_time(record, settling_s)
    samples = round(time / record.sampling_time)
    if len(record) - samples < _FEWEST:
        raise InputError(
            f"{record.source or record.name}: {len(record)} samples are too few: the first {time:.3g} s settle "
            f"(tissue.settling_s), {max(len(record) - samples, 0)} follow, and at least {_FEWEST} must; record longer or faster"
        )
    return samples


def assemble_experiment(
    first: Record, fitted: Sequence[FitData], tests: Sequence[FitData], floor: NoiseFloor | None, **known
) -> Experiment:
    """Return an experiment of prepared records; the floor is from `first`, along one axis.

    If there are no others, the last part of every record is held back; what began in the first part goes on there. `known` are
    further fields of the experiment.
    """
    if not tests:
        fitted, tests = zip(*(item.split(1 - _HELD_BACK) for item in fitted), strict=True)
    position, force = first.channels["input"], first.channels["output"]
    return Experiment(
        training=fitted[0] if len(fitted) == 1 else JointData.join(list(fitted)),
        tests=list(tests),
        floor=floor,
        input_unit=position.unit,
        output_unit=force.unit,
        floor_from=first.name,
        input_quantity=position.quantity,
        output_quantity=force.quantity,
        **known,
    )


def check_excitation(training: Record, others: list[Record]) -> None:
    """Reject a training record that hardly moves compared with the others, and records in different units."""
    for other in others:
        stiffness = _slow_stiffness(training) / max(_slow_stiffness(other), 1e-300)
        if max(stiffness, 1 / max(stiffness, 1e-300)) > _UNIT_FACTOR:
            position, force = (
                float(np.std(training[role]) / np.std(other[role])) for role in ("input", "output")
            )
            moved = abs(np.log(position)) > abs(np.log(force))
            channel = training.channels["input" if moved else "output"]
            raise InputError(
                f"{training.source or training.name}: its {channel.quantity} is {position if moved else force:.3g} times that "
                f"of {other.name}, at a like {'force' if moved else 'motion'}: the records seem to be in different units; all "
                f"must be in {channel.unit}, or give each its scale in the layout"
            )
        share = float(np.ptp(training["input"]) / np.ptp(other["input"]))
        if share < _LEAST_RANGE:
            unit = training.channels["input"].unit
            raise InputError(
                f"{training.source or training.name}: it moves by {np.ptp(training['input']):.3g} {unit} where {other.name} "
                f"moves by {np.ptp(other['input']):.3g} {unit}: a model fitted on it says nothing about {other.name}; train on "
                "another record, or record one that moves as far"
            )


def check_unseen(fitted: Sequence[Record], others: Sequence[Record]) -> None:
    """Reject records that contain samples of a training record: they are not unseen."""
    for known, other in product(fitted, others):
        roles = [*known.roles("input"), *known.roles("output")]
        whole, part = (np.stack([item[role] for role in roles], axis=1) for item in (known, other))
        length = min(_COPIED, len(part))
        for begins in np.linspace(0, len(part) - length, _LOOKS).astype(int):
            stretch = part[begins : begins + length]
            if max(len(np.unique(column)) for column in stretch.T) < length / 4:
                continue  # at rest all records are equal
            places = np.flatnonzero(whole[:, -1] == stretch[0, -1])
            same = [place for place in places if np.array_equal(whole[place : place + length], stretch)]
            if same:
                at, there = other.time[begins], known.time[same[0]]
                raise InputError(
                    f"{other.source or other.name}: its samples at {at:.6g} s are those of {known.source or known.name} at "
                    f"{there:.6g} s: what a model was fitted to is not unseen; leave the copy out, or cut parts apart"
                )


def _slow_stiffness(record: Record) -> float:
    """Spread of the force over that of the position where the position changes slowly."""
    speed = np.abs(np.gradient(record["input"]))
    slow = speed <= np.quantile(speed, _SLOWEST)
    return float(np.std(record["output"][slow]) / max(np.std(record["input"][slow]), 1e-300))


def check_response(training: Record, floor: NoiseFloor | None) -> None:
    """Refuse a training record whose response is little but noise."""
    if floor is None or np.var(training["output"]) > _ABOVE_NOISE * floor.rms**2:
        return
    channel, spread = training.channels["output"], np.std(training["output"])
    raise InputError(
        f"{training.source or training.name}: its {channel.quantity} varies by {spread:.3g} {channel.unit} RMS, of which "
        f"{floor.rms:.3g} is noise: nothing can be fitted to it; excite more strongly"
    )


def _noise_floor_of(chosen: list[Record]) -> tuple[Record, NoiseFloor | None]:
    """Return the first record that repeats and its noise floor; the first record and None if none repeats.

    With two periods, every change from one to the other counts as noise: they are used only if no record has more.
    """
    for fewest in (MIN_FULL_PERIODS, MIN_PERIODS):
        for record in chosen:
            floor = noise_floor(replace(record, period=declared_period(record, fewest)), fewest=fewest)
            if floor is not None:
                return record, floor
    return chosen[0], None


def _fit_data(
    record: Record, whitening: np.ndarray, settling: dict[str, int], past: dict[str, tuple[Record, int]]
) -> FitData:
    record, begins = past.get(record.name, (record, 0))
    samples = settling[record.name]
    return FitData(record.name, Motion.of(record), record["output"], whitening, samples, begins=begins)
