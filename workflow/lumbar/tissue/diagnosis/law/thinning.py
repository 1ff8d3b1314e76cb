"""Records at a lower rate to choose the terms of a law on: a term that is there is there at any rate its motion allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lumbar.tissue.diagnosis.fitting.decimation import PER_CYCLE, band_edge
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.models.motion import Motion

_ENOUGH = 6000
"""Samples of the training record that are left, if its excitation allows it."""


def thinned(experiment: Experiment) -> Experiment:
    """The experiment with every n-th sample of its records, as many as leave `PER_CYCLE` in the fastest cycle of each.

    As where records are too long for a diagnosis, nothing is filtered. Errors are then taken as they are: the colour of the
    noise is that of another rate. The same experiment where there is nothing to spare.
    """
    records = [experiment.training, *experiment.tests]
    parts = [part for item in records for part in (item.parts if isinstance(item, JointData) else (item,))]
    edges = [band_edge(part.own(part.motion.position)) for part in parts]
    room = min(int(1 / (PER_CYCLE * edge)) for edge in edges)
    factor = min(room, experiment.training.size // _ENOUGH)
    if factor < 2:
        return experiment
    training, *tests = (_thinned(item, factor) for item in records)
    return replace(experiment, training=training, tests=tests)


def _thinned(data: FitData, factor: int) -> FitData:
    if isinstance(data, JointData):
        found = JointData.of([_thinned(part, factor) for part in data.parts])
        return replace(found, own_zero=data.own_zero)
    motion, kept = data.motion, slice(data.begins % factor, None, factor)
    position = motion.position[kept]
    step = factor * motion.sampling_time
    channels = {name: values[kept] for name, values in motion.channels.items()}
    lower = Motion(np.arange(len(position)) * step, position, step, motion.smooth, channels)
    return FitData(
        data.name,
        lower,
        data.force[kept],
        counts_from=data.counts_from,
        own_zero=data.own_zero,
        begins=data.begins // factor,
    )
