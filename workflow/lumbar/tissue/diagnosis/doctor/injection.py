"""A refined model taken for the truth: records as it would have answered, with an effect put in at any strength."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, nonlinear_starts, shape_bounds
from lumbar.tissue.diagnosis.fitting.uncertainty import beyond, tangent_basis
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.selection.candidate import with_forms
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.motion import OneMotion, SpatialMotion
from lumbar.tissue.perception.felt import force_difference
from lumbar.tissue.perception.thresholds import Hands

_LARGEST = 10.0
"""RMS of the response, in those of the record, up to which a parallel form's force is scaled."""
_NOTHING = 1e-6
"""Share of a force that is left by rounding alone."""
_ROUNDS = 4
"""Fixed-point iterations for the strength at which an effect becomes visible: its share beyond the model moves little."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The refined model of a diagnosis, and the noise that its answers are measured with."""

    verdict: Verdict
    """The diagnosis of the records themselves."""
    templates: tuple[Record, ...]
    """The records with the motion that the diagnosis saw."""
    motions: tuple[OneMotion, ...]
    """Of each of them, counted from the surface."""
    disturbances: tuple[np.ndarray, ...]
    """What is added to each one's simulation: noise, and the record's own zero."""
    begins: tuple[int, ...]
    """Sample of each motion at which the record itself begins."""

    @classmethod
    def of(cls, verdict: Verdict, records: Sequence[Record], seed: int) -> Self:
        """Take the model of a diagnosis of these records for the truth.

        Where the model reaches the noise floor, noise has the floor's spectrum; elsewhere it is what the model leaves of each
        record with its phases drawn anew (Theiler et al., Physica D 58 (1992) 77-94), so that everything unexplained counts as
        noise.
        """
        experiment, fit = verdict.experiment, verdict.model.fit
        templates, motions, disturbances, begins = [], [], [], []
        for number, (record, data) in enumerate(_pairs(verdict, records)):
            generator = np.random.default_rng([seed, number])
            residual = data.trim(data.force - fit.simulate(data.motion))
            zeros = experiment.own_zeros and fit.structure.base.sensor_zero
            if reaches_floor(verdict) and len(data.by_axis) == 1:
                noise = floor_noise(experiment.floor, data.length, data.motion.sampling_time, generator)
                disturbance = noise + (float(np.mean(residual)) if zeros else 0.0)
            else:
                disturbance = _of_channels(residual, data, zeros, generator)
            templates.append(_as_seen(record, data, experiment.surface))
            motions.append(data.motion)
            disturbances.append(disturbance)
            begins.append(data.begins)
        return cls(verdict, tuple(templates), tuple(motions), tuple(disturbances), tuple(begins))

    @property
    def fit(self) -> Fit:
        """The refined model."""
        return self.verdict.model.fit

    @property
    def noise(self) -> float:
        """Noise per sample, RMS in the output's unit."""
        floor = self.verdict.experiment.floor
        return floor.rms if floor and reaches_floor(self.verdict) else self.verdict.model.train_rms

    @property
    def training(self) -> FitData:
        """The records that a diagnosis fits to."""
        return self.verdict.experiment.training

    def records(self, fit: Fit) -> list[Record]:
        """The records as they would be if this model were the truth."""
        found = []
        for template, motion, disturbance, begins in zip(
            self.templates, self.motions, self.disturbances, self.begins, strict=True
        ):
            roles = template.roles("output")
            values = np.split(fit.simulate(motion)[begins:] + disturbance, len(roles))
            found.append(template.with_values(**dict(zip(roles, values, strict=True))))
        return found


def reaches_floor(verdict: Verdict) -> bool:
    """Whether the refined model leaves no more than noise of a known size."""
    floor = verdict.experiment.floor
    return floor is not None and 0 < verdict.model.train_rms <= COMPLETE * floor.rms


def _pairs(verdict: Verdict, records: Sequence[Record]) -> list[tuple[Record, FitData]]:
    """Every record beside its prepared data, whole."""
    training, tests = verdict.experiment.training, verdict.experiment.tests
    trained = training.records
    # A record of which the end is held back stands among the tests whole.
    data = {item.name: item for item in (*trained, *tests)}
    return [(record, data[record.name]) for record in records]


def _of_channels(
    residual: np.ndarray, data: FitData, own_zeros: bool, generator: np.random.Generator
) -> np.ndarray:
    """Noise of every channel of a force sensor, of the spectrum of what is left there, one after the other."""
    pieces = []
    for part, left in zip(data.by_axis, data.by_record(residual), strict=True):
        noise = phase_randomised(left - np.mean(left), part.length, generator)
        pieces.append(noise + (np.mean(left) if own_zeros else 0.0))
    return np.concatenate(pieces)


def _as_seen(record: Record, data: FitData, surface: float) -> Record:
    motion = data.motion
    if isinstance(motion, SpatialMotion):
        seen = dict(zip(record.roles("input"), [part.position for part in motion.parts], strict=True))
        return record.with_values(**seen, **dict.fromkeys(record.roles("output"), 0.0 * motion.time))
    position = data.own(motion.position) + surface
    beside = {
        role: replace(channel, values=data.own(motion.channels[role]))
        for role, channel in record.channels.items()
        if role in motion.channels
    }
    channels = {
        "input": replace(record.channels["input"], values=position),
        "output": replace(record.channels["output"], values=np.zeros_like(position)),
        **beside,
    }
    time = data.own(motion.time)
    return replace(record, time=time - time[0] + record.time[0], channels=channels, filled=())


def floor_noise(
    floor: NoiseFloor, samples: int, sampling_time: float, generator: np.random.Generator
) -> np.ndarray:
    """Gaussian noise with the spectrum and the size of a noise floor, shape (samples,)."""
    amplitude = np.sqrt(floor.density(np.fft.rfftfreq(samples, sampling_time)))
    noise = np.fft.irfft(amplitude * np.fft.rfft(generator.standard_normal(samples)), samples)
    return noise * floor.rms / np.std(noise) if np.std(noise) > 0 else noise


def phase_randomised(signal: np.ndarray, samples: int, generator: np.random.Generator) -> np.ndarray:
    """Signal of the same spectrum with random phases, continued periodically to a length."""
    spectrum = np.fft.rfft(signal)
    phases = np.exp(2j * np.pi * generator.uniform(size=len(spectrum)))
    # The mean, and of an even number of samples the last line, are real.
    phases[0] = 1.0
    if len(signal) % 2 == 0:
        phases[-1] = 1.0
    return np.resize(np.fft.irfft(spectrum * phases, len(signal)), samples)


@dataclass(frozen=True, eq=False)
class Injection:
    """A form added to a fitted model, with one dose that its force grows with.

    The dose of a parallel form scales its forces; of a form at the input or output it is the one of its parameters that
    changes the force most, e.g. a delay or a limit, in the direction in which it does.
    """

    model: Fit
    """Without the effect."""
    form: Form
    start: np.ndarray
    """Nonlinear parameters of the form."""
    data: FitData
    """Training record, on which strengths are measured."""

    @classmethod
    def middle(cls, model: Fit, form: Form, data: FitData) -> Self:
        """Add a form with the middle one of its starting values."""
        starts = nonlinear_starts(form, data, data.force - model.simulate(data.motion))
        return cls(model, form, starts[len(starts) // 2], data)

    @property
    def largest(self) -> float:
        """Largest RMS that the force can have, in the output's unit; 0 where these motions do not call the effect forth."""
        return self._doses[1]

    def at(self, rms: float) -> Fit:
        """The model with the effect, its force of this RMS over the samples that count of the training record.

        Raises
        ------
        ValueError
            Beyond `largest`.
        """
        if not 0 < rms <= self.largest * (1 + 1e-9):
            raise ValueError(f"{self.form.key}: {rms:g} is not between 0 and {self.largest:g}")
        fit_at, largest = self._doses
        if self.form.place is Place.PARALLEL and self.model.structure.is_linear:
            return fit_at(rms / largest)
        return fit_at(self._dose_of(min(rms, largest)))

    def predict(self, least: float) -> float | None:
        """Smallest RMS of the force of which the RMS `least` is visible, to first order.

        Visible is what the model's own parameters cannot take up, after whitening, as of
        `lumbar.tissue.diagnosis.evidence.evidence.detectable_effects`. None where they take up all of it.
        """
        rms = min(least, self.largest)
        for _ in range(_ROUNDS):
            fit = self.at(rms)
            share = self._visible(fit) / self.rms(fit)
            if not share > _NOTHING:
                return None
            rms = min(least / share, self.largest)
        return float(least / share)

    def _visible(self, fit: Fit) -> float:
        """RMS of what the model without the effect leaves of the added force, whitened."""
        left = beyond(self._basis, self.data.whiten(fit.simulate(self.data.motion) - self._without))
        return float(np.sqrt(np.mean(left**2)))

    @cached_property
    def _basis(self) -> np.ndarray:
        return tangent_basis(self.model, [self.data])

    def rms(self, fit: Fit) -> float:
        """RMS of what another model adds to the one without the effect, over the samples that count."""
        added = fit.simulate(self.data.motion) - self._without
        return float(np.sqrt(np.mean(self.data.trim(added) ** 2)))

    def just_felt(self, rms: float, unit: str, hands: Hands) -> float | None:
        """RMS of the force that a hand just feels, to first order about this RMS; None where the output is no force."""
        motion, without = self.data.motion, self._without
        if isinstance(motion, SpatialMotion):
            return None  # what hands tell of a force in space is another matter
        fit = self.at(rms)
        force = fit.simulate(motion)
        met = force_difference(without, force, unit, motion.position, motion.sampling_time, hands)
        return None if met is None or not met.felt.jnd.value else self.rms(fit) / met.felt.jnd.value

    @cached_property
    def _without(self) -> np.ndarray:
        return self.model.simulate(self.data.motion)

    def _with(self, linear: np.ndarray, nonlinear: np.ndarray) -> Fit:
        model = self.model
        return replace(
            model,
            structure=model.structure.with_form(self.form),
            linear=np.concatenate([model.linear, linear]),
            nonlinear=np.concatenate([model.nonlinear, nonlinear]),
        )

    @cached_property
    def _doses(self) -> tuple[Callable[[float], Fit], float]:
        """Model by dose, which lies between 0 (no effect) and 1 (the largest), and the largest RMS."""
        if self.form.place is Place.PARALLEL:
            amplitudes = self._amplitudes()
            largest = _LARGEST * float(np.sqrt(np.mean(self.data.trim(self.data.force) ** 2)))
            unit = self.rms(self._with(amplitudes, self.start))
            scale = largest / unit if unit > _NOTHING else 0.0

            def scaled(dose: float) -> Fit:
                return self._with(dose * scale * amplitudes, self.start)

            return scaled, self.rms(scaled(1.0))
        return self._by_parameter()

    def _amplitudes(self) -> np.ndarray:
        """Linear parameters whose forces have RMS 1 each; those that the mechanism can do without are 0."""
        essential = self.form.essential or tuple(item.name for item in self.form.linear)
        found = np.zeros(len(self.form.linear))
        for number, item in enumerate(self.form.linear):
            unit = np.zeros(len(found))
            unit[number] = -1.0 if item.sign < 0 else 1.0
            size = self.rms(self._with(unit, self.start))
            if item.name in essential and size > 0:
                found[number] = unit[number] / size
        return found

    def _by_parameter(self) -> tuple[Callable[[float], Fit], float]:
        """Dose along the nonlinear parameter, from the end of its range that changes nothing to the other."""
        empty = np.zeros(0)
        structure = self.model.structure.with_form(self.form)
        start = np.concatenate([self.model.nonlinear, self.start])
        low, high = (
            bound[len(self.model.nonlinear) :] for bound in shape_bounds(structure, self.data, start)
        )
        ends = []
        for number in range(len(self.start)):
            for weak, strong in ((low[number], high[number]), (high[number], low[number])):
                changes = [self.rms(self._with(empty, self._moved(number, end))) for end in (weak, strong)]
                ends.append((changes[1] - changes[0], number, float(weak), float(strong)))
        _, number, weak, strong = max(ends)

        def along(dose: float) -> Fit:
            return self._with(empty, self._moved(number, float(weak ** (1 - dose) * strong**dose)))

        return along, self.rms(along(1.0))

    def _moved(self, number: int, value: float) -> np.ndarray:
        moved = np.array(self.start, dtype=float)
        moved[number] = value
        return moved

    def _dose_of(self, rms: float) -> float:
        """Dose at which the added force has this RMS, by Brent's method; 0 where the least dose adds more."""
        fit_at, _ = self._doses

        def above(dose: float) -> float:
            return self.rms(fit_at(dose)) - rms

        if above(0.0) >= 0:
            return 0.0
        return 1.0 if above(1.0) <= 0 else float(scipy.optimize.brentq(above, 0.0, 1.0, xtol=1e-9, rtol=1e-7))


def without_effect(fit: Fit, effect: str) -> tuple[Fit, Form, np.ndarray]:
    """Take an effect out of a fitted model: the model without it, its form and its nonlinear parameters."""
    form = next(item for item in fit.structure.forms if item.effect == effect)
    _, nonlinear = fit.structure.nonlinear_of(fit.nonlinear)
    return with_forms(fit, fit.structure.without(effect).forms), form, nonlinear[form.key]
