"""What every model asks of a device: the table model × device, words for an FMU's page, a warning or refusal at export."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import replace

from lumbar.base.errors import NumericalError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tables.table import Table
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.haptics.judgement import Judgement, analyse, judge_exported
from lumbar.tissue.haptics.passivity import FASTEST_HZ
from lumbar.tissue.haptics.rendered_model import REACH_MM, render_model, renderable
from lumbar.tissue.haptics.simulation import DURATION_S, PUSH_MM, PUSH_S
from lumbar.tissue.models.fitted_model import FittedModel

_PROVED = "proved_gain"
_DEFINITIONS = {
    "model": "Name of the model",
    "rate_Hz": (
        "Rate at which the model samples the position. At each tick of the servo it takes the samples that have come, at "
        "positions on a straight line from tick to tick, and the force of the newest is held until the next tick"
    ),
    "damping_needed_N_s_m": (
        "Smallest damping of the device with which it is passive with the model in any passive hand: largest over all "
        "frequencies of T/2 · Re{(1 − exp(−jωT)) H(exp(jωT))}/(1 − cos ωT), moving average and delays in H; of a model with "
        "effects the largest of its linearisations; empty with a negative static stiffness H(1), where none is enough"
    ),
    "passive": (
        "Whether the device has that damping, the force is not limited in its rate and does not change with time alone, and the "
        "simulation comes to rest; of a model with effects over the motion that it was fitted to"
    ),
    "largest_stable_gain": (
        "Factor on the model's force below which the loop with device and hand is stable for every factor from 0 on; "
        "exact for the held force; below 1 the model itself is unstable in this hand; empty where no factor is too large; with "
        "uneven ticks that of the worst timing that was found"
    ),
    _PROVED: "Factor up to which the loop is proved to be stable whenever its uneven ticks come",
    "stable": "Whether it is above 1, and the simulation comes to rest: where both differ the worse counts",
    "lowest_passive_rate_Hz": (
        f"Lowest rate of even ticks, from that of identification to {FASTEST_HZ:g} Hz, from which on the device is passive with "
        "the model; empty where there is none, where the model has no counterpart at other rates, or where it has effects"
    ),
    "lowest_stable_rate_Hz": "The same for a stable loop in this hand: the lowest safe rate where nothing else holds the device",
    "oscillation_Hz": "Frequency of what the simulated loop keeps doing; empty where it does not oscillate",
    "simulated": "What it does: oscillates, runs away until the force is at its limit, or comes to rest",
    "stable_share_percent": "Share of hands, and of fits within the intervals of their parameters, in which the loop is stable, "
    "by its poles; empty where it was not looked at",
    "worst_hand": "The hand, and the fit, in which it is least so",
    "oscillation_N": "Peak to peak force in the last quarter of the simulation",
}
_DECIMALS = {
    **dict.fromkeys(("damping_needed_N_s_m", "largest_stable_gain", _PROVED, "oscillation_N"), 2),
    **dict.fromkeys(
        ("rate_Hz", "lowest_passive_rate_Hz", "lowest_stable_rate_Hz", "stable_share_percent"), 0
    ),
    "oscillation_Hz": 1,
}


def device_table(
    judgements: Sequence[Judgement], refused: Sequence[str], settings: RuntimeSettings, data: str
) -> Table:
    """Return the table; `refused` says why models have no row at a rate."""
    import pandas as pd

    rows = [
        {
            "model": item.analysis.name,
            "rate_Hz": item.analysis.rate,
            "damping_needed_N_s_m": finite(item.analysis.damping),
            "passive": _yes(item.passive),
            "largest_stable_gain": finite(item.analysis.gain),
            _PROVED: item.analysis.proved_gain,
            "stable": _yes(item.stable),
            "lowest_passive_rate_Hz": item.lowest_passive_rate,
            "lowest_stable_rate_Hz": item.lowest_stable_rate,
            "oscillation_Hz": item.run.frequency,
            "simulated": item.run.outcome,
            "stable_share_percent": 100 * item.hands.share if item.hands else None,
            "worst_hand": item.hands.worst if item.hands else "",
            "oscillation_N": item.run.peak_to_peak,
        }
        for item in judgements
    ]
    optional = frozenset(_DECIMALS) - {"rate_Hz", _PROVED, "oscillation_N"}
    uneven = any(item.analysis.timings for item in judgements)
    columns = {name: text for name, text in _DEFINITIONS.items() if uneven or name != _PROVED}
    frame = pd.DataFrame(rows, columns=list(columns)).astype(dict.fromkeys(optional, float))
    effects = (
        "Models with effects are analysed through their linearisations, within the positions that they were fitted to, "
        f"±{REACH_MM:g} mm where these are not known, and simulated as their FMUs."
    )
    return Table(
        title="Models in a person's hand: what they ask of the device of the study.",
        frame=frame,
        data=data,
        definitions=columns,
        notes=(
            device_text(settings.device),
            f"Moving average of {settings.moving_average_ms:g} ms at the rate of export, over as many samples at every rate. "
            f"Simulated: the hand pushes {PUSH_MM:g} mm in {PUSH_S:g} s and rests (a stylus that nobody holds "
            f"comes in at that mean speed), {DURATION_S:g} s in all, the force within "
            f"±{settings.output_limit:g} of the model's unit.",
            "Forces count with the sign that resists the motion; a model that is inverted on purpose, as IL is, is displayed "
            "like the others and draws the tool in.",
            *([effects] if any(item.model.linearised for item in judgements) else []),
            *refused,
        ),
        decimals=_DECIMALS,
        may_be_empty=optional | {"worst_hand"},
    )


def device_text(device: DeviceSettings) -> str:
    """One sentence on device and hand."""
    hand = f"{device.hand_stiffness_N_m:g} N/m"
    hand += f", {device.hand_damping_N_s_m:g} N·s/m" if device.hand_damping_N_s_m else ""
    hand += f", {device.hand_mass_kg:g} kg" if device.hand_mass_kg else ""
    friction = f", {device.friction_N:g} N of dry friction" if device.friction_N else ""
    delay = f", forces {device.delay_ms:g} ms late" if device.delay_ms else ""
    jitter = f", ticks up to {device.jitter_percent:g} % early or late" if device.jitter_percent else ""
    missed = f", up to {device.missed_ticks} in a row left out" if device.missed_ticks else ""
    return (
        f"Device: {device.mass_kg:g} kg, {device.damping_N_s_m:g} N·s/m{friction}, servo at {device.rate_Hz:g} Hz{jitter}"
        f"{missed}, encoder of {device.encoder_um:g} µm{delay}; hand: {hand}."
    )


def finite(value: float) -> float | None:
    """A number of a table; None, an empty cell, where it is infinite."""
    return value if math.isfinite(value) else None


def _yes(holds: bool) -> str:
    return "yes" if holds else "NO"


_ADVICE = (
    "raise runtime.rate_Hz, export a passive model (runtime/passive_models.json of the study), bound the force "
    "(runtime.device_damping), or take a device with more damping; 'lumbar render' says what helps"
)


def with_device(
    models: Sequence[ExportModel], settings: RuntimeSettings, fitted: Sequence[FittedModel]
) -> list[ExportModel]:
    """Judge the models on the device, say so in them, and warn of those that are not safe.

    Parameters
    ----------
    fitted : sequence of FittedModel
        What they were exported from.
    settings : RuntimeSettings
        ``device.unsafe`` says whether an unstable loop is told on standard error or is an error.

    Returns
    -------
    list of ExportModel
        With ``on_device``.

    Raises
    ------
    NumericalError
        A loop is unstable and ``unsafe`` is ``"refuse"``.
    """
    device, told, unsafe = settings.device, [], []
    for model, source in zip(models, fitted, strict=True):
        if not renderable(model):
            told.append(model)
            continue
        judged = judge_exported(model, settings, source)
        sentences = [device_text(device)]
        damping = model.guards.device_damping
        bounded = 0.0 < damping <= device.damping_N_s_m and judged.analysis.prompt
        if bounded:
            sentences.append(
                "The bound by device_damping, which the analysis leaves out, keeps the device passive whatever it says."
            )
        if not (judged.safe or (bounded and judged.run.calm)):
            unsafe.append(judged)
        # A force that does not depend on the position of its own sample is read alike.
        sentences.append(
            f"{'In event mode' if model.feedthrough else 'However it is read'}: {judged.finding}."
        )
        if model.feedthrough:
            late = analyse(render_model(model, device, late=True), device)
            sentences.append(
                f"Read as FMI 2.0 reads, the position set after, by the analysis: {late.finding}."
            )
        told.append(replace(model, on_device=tuple(sentences)))
    _tell(unsafe, device)
    return told


def _tell(unsafe: list[Judgement], device: DeviceSettings) -> None:
    if not unsafe:
        return
    text = "\n".join(f"  {found.finding}" for found in unsafe)
    if device.unsafe == "refuse":
        raise NumericalError(
            f"not safe on the device of runtime.device, not exported:\n{text}\n{_ADVICE}, or say runtime.device.unsafe: warn"
        )
    print(f"WARNING: not safe on the device of runtime.device:\n{text}\n  {_ADVICE}", file=sys.stderr)
