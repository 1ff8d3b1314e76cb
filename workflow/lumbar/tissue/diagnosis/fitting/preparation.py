"""From validated records to data for fitting: training and test records, sessions, checks, noise floor, whitening."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Self

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record, require_clock, require_one_axis, require_same_units
from lumbar.records.rests import begins_at_rest, find_levels, find_two_levels
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
from lumbar.tissue.signals.spectrum import occupied_band

_MOVE_SHARE = 0.5
"""Duration of the move between two records if their clocks show no pause, relative to the time scale of a record."""
_MAX_STEP_RATIO = 1.5
"""Largest step between two records, relative to the steps within them: a larger step is a move that was not recorded."""
_MAX_PAUSE_RATIO = 10.0
"""Longest pause between two records, in durations of all records: a longer pause is an error of the clocks."""
_MAX_UNIT_RATIO = 200.0
"""Ratio of two records' force over position, in slow motion, above which their units must differ."""
_SLOW_SHARE, _POSITION_BINS = 0.3, 10
"""Share of the samples at a position that count as slow, because the force at high speed has no limit; number of positions."""
_MIN_UNIT_CORRELATION = 0.3
"""Smallest correlation of force and position of a record that moves: counts of an encoder at rest do not show a stiffness."""
_REST_SHARE = 0.01
"""Largest motion of a tool at rest, as a share of the range in training."""
_RETURN_SHARE = 0.05
"""Largest path in excess of the range, as a share of the range, of a motion in one direction."""
_MIN_RANGE_SHARE = 0.05
"""Smallest share of another record's range that a training record must cover, and of its positions that a motion must cover."""
_MIN_RESPONSE_VARIANCE = 2.0
"""Variance of a response in noise variances, below which it is mostly noise."""
_MAX_ERROR_OVER_FLOOR = 3.0
"""Ratio of an error to the noise floor above which the error is due to the model."""
_BEGINNINGS, _MAX_BEGINNING_DISTANCE = 100, 0.05
"""Ratio of a record's samples to those of its beginning; largest distance of beginnings at one place, in total ranges."""
_MIN_COPY_LENGTH, _COPY_PLACES = 64, 9
"""Number of equal samples in a row that show a copy of another record; number of places that are compared."""
_MIN_SAMPLES = 50
"""Smallest number of samples after the start of a record, which is excluded from errors."""
_MAX_SINE_BAND = 1.5
"""Largest ratio of the highest to the lowest frequency of a sine."""
_TEST_SHARE = 0.3
"""Share of a record that is used as test if there is no other record."""


def add_session_history(records: Sequence[Record]) -> dict[str, tuple[Record, int]]:
    """Return every record together with all records before it in the session, and the sample at which it begins, by name.

    Pauses are taken from the clocks if each record begins after the end of the record before; otherwise they are 0 s. The tool
    moves smoothly to the next record during the pause, or within half a time scale if it jumps; errors exclude the force there.

    Raises
    ------
    InputError
        If sampling times or channels differ, or a pause is longer than ten times all records together.
    """
    check_equal_rates(records, "records of one session")
    first = records[0]
    step = max(float(np.abs(np.diff(record["input"])).max()) for record in records)
    longest = _MAX_PAUSE_RATIO * sum(record.duration for record in records)
    has_clock = all(after.time[0] > before.time[-1] for before, after in pairwise(records))
    past = replace(first, time=np.arange(len(first)) * first.sampling_time)
    histories = {first.name: (past, 0)}
    for before, record in pairwise(records):
        label = record.source or record.name
        if set(record.channels) != set(first.channels):
            raise InputError(
                f"{label}: has the channels {', '.join(record.channels)}, {first.name} {', '.join(first.channels)}; records of "
                "one session need the same ones"
            )
        pause = float(record.time[0] - before.time[-1]) if has_clock else 0.0
        if pause > longest:
            raise InputError(
                f"{label}: begins {pause:g} s after the end of the record before it, more than {_MAX_PAUSE_RATIO:g} times all "
                "records together; correct the times, or leave session out"
            )
        between = max(round(pause / past.sampling_time) - 1, 0)
        if not between and abs(record["input"][0] - past["input"][-1]) > _MAX_STEP_RATIO * step:
            between = round(_MOVE_SHARE * past.time_scale / past.sampling_time)
        share = np.arange(1, between + 1) / (between + 1)
        progress = share**2 * (3 - 2 * share)
        values = {}
        for role in record.channels:
            start, end = past[role][-1], record[role][0]
            values[role] = np.concatenate([past[role], start + progress * (end - start), record[role]])
        begins = len(past) + between
        past = record.with_samples(np.arange(begins + len(record)) * past.sampling_time, values)
        histories[record.name] = past, begins
    return histories


def simulate_in_session(
    records: Sequence[Record], simulate: Callable[[Record], np.ndarray]
) -> Callable[[Record], np.ndarray]:
    """Return a simulation that first runs through all records before the simulated record."""
    histories = add_session_history(records)
    return lambda record: simulate(histories[record.name][0])[histories[record.name][1] :]


def check_equal_rates(records: Sequence[Record], together: str) -> None:
    """Reject records with different sampling times; `together` names them in the message."""
    first = records[0]
    for record in records[1:]:
        if not np.isclose(record.sampling_time, first.sampling_time, rtol=1e-6):
            raise InputError(
                f"{record.source or record.name}: sampled every {record.sampling_time:g} s, {first.name} every "
                f"{first.sampling_time:g} s; {together} need one sampling time: give a rate (tissue.rate_Hz)"
            )


@dataclass(frozen=True, eq=False)
class Experiment:
    """A set of records ready for diagnosis."""

    training: FitData
    """Training data; `JointData` if several records are fitted together."""
    tests: list[FitData]
    """Unseen records; the last part of the training record if there is no other record."""
    floor: NoiseFloor | None
    """Noise floor of the output; None if no record repeats."""
    input_unit: str
    output_unit: str
    floor_from: str
    """Name of the training record in which the noise floor was searched."""
    input_quantity: str = "position"
    output_quantity: str = "force"
    rest: tuple[float, ...] = (0.0,)
    """Origin along every axis of the positions of a fastened tool: 0, or the origin of `shift_to_rest`."""
    surface: float = 0.0
    """Origin of the positions along one axis: the surface if the tool is not fastened to the tissue, else `rest`."""
    records: tuple[Record, ...] = ()
    """All records, with faults of their sensors repaired."""
    faults: tuple[Finding, ...] = ()
    session: bool = False
    """True if each record begins in the state at the end of the record before."""
    settling_s: float | None = None
    """Seconds at the start of every record that are excluded from errors; default `excluded_time` of the record."""
    position_noise_force: float = 0.0
    """RMS of the force caused by known position noise within the excitation's band, which is not filtered out."""

    @classmethod
    def from_records(
        cls,
        records: Sequence[Record],
        settings: DiagnosisSettings,
        repaired: tuple[list[Record], list[Finding]] | None = None,
    ) -> Self:
        """Prepare records of one axis; records of a tissue test are repaired, and their positions counted from rest.

        `repaired` is the result of `repair`, if known. Exceptions are those of `prepare`.
        """
        if settings.system != "tissue":
            converted = [for_base(record, BASES[settings.base]) for record in records]
            return prepare(converted, **settings.preparation, records=tuple(records))
        valid, faults = repaired or repair(records)
        force = force_of_position_noise(records, valid, faults)
        fields = {"faults": tuple(faults), "position_noise_force": force}
        return prepare(valid, **settings.preparation, **fields).shift_to_rest()

    @property
    def points(self) -> bool:
        """True for points of a static test, without a clock."""
        return any(record.points for record in self.records)

    @property
    def size(self) -> int:
        """Number of samples of all records that count."""
        return self.training.size + sum(item.size for item in self.tests)

    @property
    def is_split(self) -> bool:
        """True if the tests are parts of the training records, because there is no other record."""
        return {item.name for item in self.tests} <= {item.name for item in self.training.records}

    @property
    def test_data(self) -> str:
        """Name of the data that no fit uses, for sentences on errors."""
        if not self.is_split:
            return "unseen records"
        return "the points held back" if self.points else "the last part of the record"

    @property
    def noise(self) -> float:
        """RMS of the noise floor; 0 if the floor is unknown."""
        return 0.0 if self.floor is None else self.floor.rms

    @property
    def is_unseen_at_rest(self) -> bool:
        """True if the position rests in all unseen parts, e.g. in the end of a stress-relaxation test."""
        span = float(np.ptp(self.training.motion.position))
        return all(np.ptp(item.trim(item.motion.position)) <= _REST_SHARE * span for item in self.tests)

    @property
    def is_one_way(self) -> bool:
        """True if no record returns: tests of stress relaxation, of one or several steps."""
        return all(
            np.abs(np.diff(record["input"])).sum() <= (1 + _RETURN_SHARE) * np.ptp(record["input"])
            for record in self.records
            if not record.axes
        )

    @property
    def extra_floor_rms(self) -> float:
        """RMS error of a right model in addition to the floor: force of position noise, and drift that may be a moving zero."""
        floor = self.floor
        drift = 0.0 if floor is None or floor.certain_structure_rms else floor.structured_rms
        return float(np.hypot(self.position_noise_force, drift))

    def shift_origin(self, surface: float, **fields) -> Self:
        """Return the same records with positions counted from `surface`; `fields` are other new values."""
        shift = surface - self.surface
        return self.each(lambda item: item.shift_origin(shift) if shift else item, surface=surface, **fields)

    def shift_to_rest(self) -> Self:
        """Return the same records of one axis with positions counted from `resting_position`."""
        records = (*self.training.records, *self.tests)
        rest = resting_position([item.drop_history(item.motion.position)[None] for item in records])
        return self.shift_origin(float(rest[0]), rest=tuple(rest))

    @property
    def has_own_zeros(self) -> bool:
        """True if every record has its own zero of the sensor."""
        return all(item.has_own_zero for item in self.tests)

    def allow_own_zeros(self) -> Self:
        """Return the same records, each with its own zero of the sensor."""
        own = [replace(item, has_own_zero=True) for item in (self.training, *self.tests)]
        # A single training record has one zero anyway: its fits stay valid.
        training = own[0] if isinstance(self.training, JointData) else self.training
        return replace(self, training=training, tests=own[1:])

    def drop_whitening(self) -> Self:
        """Return the same records without whitening of their errors."""
        return self.each(FitData.drop_whitening)

    def change_data(self, change: Callable[[FitData], FitData], joint: type[JointData] = JointData) -> Self:
        """Return the experiment with a change of every single record; `joint` is the class of joint data."""
        return self.each(
            lambda data: (
                joint.join(list(map(change, data.parts)), data.has_own_zero)
                if isinstance(data, JointData)
                else change(data)
            )
        )

    def each(self, change: Callable[[FitData], FitData], **fields) -> Self:
        """Return the experiment with a change of training and tests; `fields` are other new values."""
        tests = [change(item) for item in self.tests]
        return replace(self, training=change(self.training), tests=tests, **fields)

    def error_dwarfs_noise(self, train_rms: float) -> bool:
        """Return whether a training error is so large that whitening would emphasise frequencies with little noise."""
        is_white = len(self.training.whitening) == 1
        return not is_white and self.floor is not None and train_rms > _MAX_ERROR_OVER_FLOOR * self.floor.rms


def prepare(
    records: Sequence[Record],
    /,
    train: str | Sequence[str] | None = None,
    session: bool = False,
    settling_s: float | None = None,
    **fields,
) -> Experiment:
    """Choose the training records, estimate their noise and prepare all records of one axis without repairs.

    `train` names one or several training records; default the longest. The other arguments are fields of the experiment.

    Raises
    ------
    InputError
        If records are missing, too short or do not match, or the training record hardly moves, is mostly noise or copied.
    """
    require_clock(records)
    require_one_axis(records, "this")
    require_same_units(records)
    settling = {record.name: settling_samples(record, settling_s) for record in records}
    chosen, others = choose_training(records, train)
    check_excitation(max(chosen, key=lambda item: float(np.ptp(item["input"]))), others)
    check_unseen(chosen, others)
    # The floor is that of the first training record that repeats. With two periods every change from one to the other counts as
    # noise: they are used only if no record has more.
    first, floor = chosen[0], None
    for fewest, record in product((MIN_FULL_PERIODS, MIN_PERIODS), chosen):
        floor = noise_floor(replace(record, period=declared_period(record, fewest)), fewest=fewest)
        if floor is not None:
            first = record
            break
    if floor is not None and np.var(first["output"]) <= _MIN_RESPONSE_VARIANCE * floor.rms**2:
        channel, spread = first.channels["output"], np.std(first["output"])
        raise InputError(
            f"{first.source or first.name}: its {channel.quantity} varies by {spread:.3g} {channel.unit} RMS, of which "
            f"{floor.rms:.3g} is noise: nothing can be fitted to it; excite more strongly"
        )
    histories = add_session_history(records) if session else {}
    is_binary = find_two_levels(records) is not None

    def prepare_record(record: Record) -> FitData:
        is_alike = np.isclose(record.sampling_time, first.sampling_time)
        whitening = np.ones(1) if floor is None or not is_alike else floor.whitening
        whole, begins = histories.get(record.name, (record, 0))
        rest = whole["output"], whitening, settling[record.name]
        levels = find_levels(whole["input"]) if is_binary else None
        moves = {} if levels is None else {"ignored": np.flatnonzero(~levels.resting)}
        return FitData(record.name, Motion.from_record(whole), *rest, begins=begins, **moves)

    fitted, tests = list(map(prepare_record, chosen)), list(map(prepare_record, others))
    fields = {"records": tuple(records), "session": session, "settling_s": settling_s, **fields}
    return assemble_experiment(first, fitted, tests, floor, **fields)


def resting_position(positions: Sequence[np.ndarray]) -> np.ndarray:
    """Return the position from which records are counted, shape (axes,): 0, unless all records are far from it.

    If no record comes as near to 0 as the range of all records, the result is their common start, or the mean position of the
    first record if they have none. `positions` has the positions of each record, shape (axes, samples), training record first.
    """
    every = np.concatenate(positions, axis=1)
    reach = float(np.linalg.norm(np.ptp(every, axis=1)))
    if reach == 0 or np.linalg.norm(every, axis=0).min() <= reach:
        return np.zeros(len(every))
    begins = np.concatenate([item[:, : 1 + item.shape[1] // _BEGINNINGS] for item in positions], axis=1)
    is_common = np.linalg.norm(np.ptp(begins, axis=1)) <= _MAX_BEGINNING_DISTANCE * reach
    rest = (begins if is_common else positions[0]).mean(axis=1)
    return np.round(rest, max(0, int(np.ceil(5 - np.log10(reach)))))  # to 1e-5 of the range


def choose_training(
    records: Sequence[Record], train: str | Sequence[str] | None
) -> tuple[list[Record], list[Record]]:
    """Return the training records, by name or the longest, and the others.

    If the longest moves at one frequency only, it does not determine a base: the record with the most different frequency, the
    longest of several, is fitted with it if another record is left unseen.
    """
    if not records:
        raise InputError("no records to diagnose")
    names = [record.name for record in records]
    wanted = [train] if isinstance(train, str) else list(train or [])
    for name in set(wanted).difference(names):
        raise InputError(f"no record {name!r}; there are {', '.join(names)}")
    chosen = [item for item in records if item.name in wanted]
    if not chosen:
        chosen = [max(records, key=len)]
        other = _partner_of_sine(chosen[0], records) if len(records) > 2 else None
        chosen = [item for item in records if item is chosen[0] or item is other]
    check_equal_rates(chosen, "records that are fitted together")
    return chosen, [item for item in records if all(item is not one for one in chosen)]


def excluded_time(record: Record, settling_s: float | None) -> float:
    """Return the seconds at the start of a record that errors exclude.

    A record that begins at rest excludes nothing: its initial state is known, and its rest shows the zeros of the sensors.
    """
    return 0.0 if settling_s is None and begins_at_rest(record) else settling_time(record, settling_s)


def _partner_of_sine(sine: Record, records: Sequence[Record]) -> Record | None:
    """Return the record whose frequency differs most from that of a sine; None if `sine` is none, or no other differs."""
    if "input" not in sine.channels or sine.points:
        return None

    def band(record: Record) -> tuple[float, float]:
        return (
            occupied_band(record["input"], record.sampling_time) if np.ptp(record["input"]) else (0.0, np.inf)
        )

    low, high = band(sine)
    if high > _MAX_SINE_BAND * low:
        return None
    alike = [item for item in records if np.isclose(item.sampling_time, sine.sampling_time, rtol=1e-6)]
    bands = [(item, *band(item)) for item in alike]
    apart = [(max(start / high, low / end), len(item)) for item, start, end in bands]
    best = max(range(len(alike)), key=lambda number: apart[number])
    return alike[best] if apart[best][0] > _MAX_SINE_BAND else None


def settling_samples(record: Record, settling_s: float | None) -> int:
    """Return the number of samples at the start of a record that errors exclude; reject a record with few other samples."""
    time = excluded_time(record, settling_s)
    samples = round(time / record.sampling_time)
    if len(record) - samples < _MIN_SAMPLES:
        raise InputError(
            f"{record.source or record.name}: {len(record)} samples are too few: the first {time:.3g} s settle "
            f"(tissue.settling_s), {max(len(record) - samples, 0)} follow, at least {_MIN_SAMPLES} must; record longer or faster"
        )
    return samples


def assemble_experiment(
    first: Record, fitted: Sequence[FitData], tests: Sequence[FitData], floor: NoiseFloor | None, **fields
) -> Experiment:
    """Return an experiment with the noise floor of `first`; without tests, the last part of every record is used as test."""
    if not tests:
        fitted, tests = zip(*(item.split(1 - _TEST_SHARE) for item in fitted), strict=True)
    position, force = first.channels["input"], first.channels["output"]
    fields |= {"input_unit": position.unit, "input_quantity": position.quantity}
    fields |= {"output_unit": force.unit, "output_quantity": force.quantity, "floor_from": first.name}
    training = fitted[0] if len(fitted) == 1 else JointData.join(list(fitted))
    return Experiment(training=training, tests=list(tests), floor=floor, **fields)


def check_excitation(training: Record, others: list[Record]) -> None:
    """Reject a training record that hardly moves compared with the others, and records in different units."""
    for other in others:
        stiffness = [_secant_stiffness(record) for record in (training, other)]
        ratio = stiffness[0] / stiffness[1] if all(stiffness) else 1.0
        if max(ratio, 1 / ratio) > _MAX_UNIT_RATIO:
            ratios = {role: np.std(training[role]) / np.std(other[role]) for role in ("input", "output")}
            role = max(ratios, key=lambda item: abs(np.log(ratios[item])))
            channel = training.channels[role]
            raise InputError(
                f"{training.source or training.name}: its {channel.quantity} is {ratios[role]:.3g} times that of {other.name} at "
                f"a similar {'force' if role == 'input' else 'motion'}: their units seem to differ; use {channel.unit} for all, "
                "or give each its scale in the layout"
            )
        ranges = [float(np.ptp(record["input"])) for record in (training, other)]
        if ranges[0] < _MIN_RANGE_SHARE * ranges[1]:
            unit = training.channels["input"].unit
            raise InputError(
                f"{training.source or training.name}: it moves by {ranges[0]:.3g} {unit}, {other.name} by {ranges[1]:.3g} "
                f"{unit}: a model fitted to it cannot predict {other.name}; train on another record, or record a larger motion"
            )


def check_unseen(fitted: Sequence[Record], others: Sequence[Record]) -> None:
    """Reject test records that contain samples of a training record, because they are not unseen."""
    for known, other in product(fitted, others):
        roles = [*known.roles("input"), *known.roles("output")]
        whole, part = (np.stack([item[role] for role in roles], axis=1) for item in (known, other))
        length = min(_MIN_COPY_LENGTH, len(part))
        for begins in np.linspace(0, len(part) - length, _COPY_PLACES).astype(int):
            interval = part[begins : begins + length]
            if max(len(np.unique(column)) for column in interval.T) < length / 4:
                continue  # at rest all records are equal
            for place in np.flatnonzero(whole[:, -1] == interval[0, -1]):
                if np.array_equal(whole[place : place + length], interval):
                    raise InputError(
                        f"{other.source or other.name}: its samples at {other.time[begins]:.6g} s are those of "
                        f"{known.source or known.name} at {known.time[place]:.6g} s: they are not unseen; leave the copy out"
                    )


def _secant_stiffness(record: Record) -> float:
    """Return the ratio of the standard deviations of force and position in slow motion; 0 if no motion shows it.

    The force is averaged at each of several positions: samples of a hold are all at one position.
    """
    position, force = record["input"], record["output"]
    # A hold far from 0 may creep by counts of its encoder: its force does not depend on these.
    if np.ptp(position) <= _MIN_RANGE_SHARE * np.abs(position).max() or not np.ptp(force):
        return 0.0
    edges = np.linspace(position.min(), position.max(), _POSITION_BINS + 1)[1:-1]
    place, speed = np.searchsorted(edges, position), np.abs(np.gradient(position))
    means = []
    for number in np.unique(place):
        inside = place == number
        slow = inside & (speed <= np.quantile(speed[inside], _SLOW_SHARE))
        means.append((position[slow].mean(), force[slow].mean()))
    moved, loaded = np.std(means, axis=0)
    correlation = abs(float(np.corrcoef(position, force)[0, 1]))
    return float(loaded / moved) if correlation >= _MIN_UNIT_CORRELATION else 0.0
