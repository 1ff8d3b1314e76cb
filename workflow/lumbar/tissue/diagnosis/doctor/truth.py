"""A refined model taken for the truth: records as it would have answered, with noise like that of the records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE
from lumbar.tissue.diagnosis.selection.ties import noise_rms
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.models.motion import Motion


@dataclass(frozen=True, eq=False)
class Truth:
    """The refined model of a diagnosis, and the noise that its answers are measured with."""

    verdict: Verdict
    """The diagnosis of the records themselves."""
    templates: tuple[Record, ...]
    """The records with the motion that the diagnosis saw."""
    motions: tuple[Motion, ...]
    """Of each of them, counted from the surface."""
    disturbances: tuple[np.ndarray, ...]
    """What is added to each one's simulation: noise, and the record's own zero."""
    begins: tuple[int, ...]
    """Sample of each motion at which the record itself begins."""

    @classmethod
    def of(cls, verdict: Verdict, records: Sequence[Record], seed: int) -> Truth:
        """Take the model of a diagnosis of these records for the truth.

        Where the model reaches the noise floor, noise has the floor's spectrum; elsewhere it is what the model leaves of each
        record with its phases drawn anew (Theiler et al., Physica D 58 (1992) 77-94), so that everything unexplained counts as
        noise.
        """
        experiment, fit = verdict.experiment, verdict.model.fit
        templates, motions, disturbances, begins = [], [], [], []
        for number, (record, data) in enumerate(_pairs(verdict, records)):
            generator = np.random.default_rng([seed, number])
            residual = data.settled(data.force - fit.simulate(data.motion))
            zero = (
                float(np.mean(residual)) if experiment.own_zeros and fit.structure.base.sensor_zero else 0.0
            )
            if reaches_floor(verdict):
                noise = floor_noise(experiment.floor, data.length, data.motion.sampling_time, generator)
            else:
                noise = phase_randomised(residual - np.mean(residual), data.length, generator)
            templates.append(_as_seen(record, data, experiment.surface))
            motions.append(data.motion)
            disturbances.append(noise + zero)
            begins.append(data.begins)
        return cls(verdict, tuple(templates), tuple(motions), tuple(disturbances), tuple(begins))

    @property
    def fit(self) -> Fit:
        """The refined model."""
        return self.verdict.model.fit

    @property
    def noise(self) -> float:
        """Noise per sample, RMS in the output's unit."""
        return noise_rms(self.verdict) if reaches_floor(self.verdict) else self.verdict.model.train_rms

    @property
    def training(self) -> FitData:
        """The records that a diagnosis fits to."""
        return self.verdict.experiment.training

    def records(self, fit: Fit) -> list[Record]:
        """The records as they would be if this model were the truth."""
        return [
            template.with_values(output=fit.simulate(motion)[begins:] + disturbance)
            for template, motion, disturbance, begins in zip(
                self.templates, self.motions, self.disturbances, self.begins, strict=True
            )
        ]


def reaches_floor(verdict: Verdict) -> bool:
    """Whether the refined model leaves no more than noise of a known size."""
    floor = verdict.experiment.floor
    return floor is not None and 0 < verdict.model.train_rms <= COMPLETE * floor.rms


def _pairs(verdict: Verdict, records: Sequence[Record]) -> list[tuple[Record, FitData]]:
    """Every record beside its prepared data, whole."""
    training, tests = verdict.experiment.training, verdict.experiment.tests
    trained = training.parts if isinstance(training, JointData) else (training,)
    # A record of which the end is held back stands among the tests whole.
    data = {item.name: item for item in (*trained, *tests)}
    return [(record, data[record.name]) for record in records]


def _as_seen(record: Record, data: FitData, surface: float) -> Record:
    motion = data.motion
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
