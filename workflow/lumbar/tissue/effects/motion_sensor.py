"""Effects of the sensor of the motion, where the force is the input: absolute value, clipping."""

from __future__ import annotations

from dataclasses import replace

from lumbar.tissue.effects.measurement_chain import SATURATION
from lumbar.tissue.models.form import Effect, Form, Place

ABSOLUTE_VALUE = Effect(
    name="absolute_value",
    mechanism="The sensor of the motion gives its absolute value: it does not tell one direction from the other.",
    source="Wigren and Schoukens, Coupled electric drives data set and reference models, Uppsala University (2017)",
    experiment="drive it to one side only, then to the other: a sensor with a sign tells them apart",
    forms=(Form(name="rectified", equation="abs(F)", place=Place.OUTPUT),),
)
_SATURATION = replace(
    SATURATION,
    mechanism="The sensor of the motion clips.",
    source="range of the motion's sensor and its amplifier",
    experiment="halve the force: a sensor that no longer clips shows no loss",
)
MOTION_SENSOR = {effect.name: effect for effect in (ABSOLUTE_VALUE, _SATURATION)}
"""Effects of the motion's sensor by name: ``F`` of their equations is what the sensor should give."""
