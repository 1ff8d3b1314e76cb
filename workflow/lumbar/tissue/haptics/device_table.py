"""Requirements of models on a device: the table model × device, text for an FMU's page, a warning or error at export."""

import math
import sys
from collections.abc import Sequence
from dataclasses import replace

from lumbar.base.errors import NumericalError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.haptics.loop_verdict import LoopVerdict, analyse, judge_loop, loop_sentence
from lumbar.tissue.haptics.rendered_model import REACH_MM, is_renderable, render_model
from lumbar.tissue.haptics.simulation import DURATION_S, PUSH_MM, PUSH_S
from lumbar.tissue.haptics.z_width import FASTEST_HZ
from lumbar.tissue.models.fitted_model import FittedModel


def device_table(
    verdicts: Sequence[LoopVerdict], refused: Sequence[str], settings: RuntimeSettings, source_label: str
) -> Table:
    """Return the table model × device; `refused` are the reasons for missing rows."""
    rows = [
        {
            "model": item.model.name,
            "rate_Hz": item.analysis.rate,
            "damping_needed_N_s_m": finite(item.analysis.damping),
            "passive": _ANSWERS[item.passive],
            "largest_stable_gain": finite(item.analysis.gain),
            "stable": _ANSWERS[item.stable],
            "lowest_passive_rate_Hz": item.lowest_passive_rate,
            "lowest_stable_rate_Hz": item.lowest_stable_rate,
            "oscillation_Hz": item.run.frequency,
            "simulated": item.run.outcome,
            "worst_hand": item.worst_hand.label if item.worst_hand else "",
            "stable_in_worst_hand": _ANSWERS[item.worst_hand.stable] if item.worst_hand else "",
            "oscillation_N": item.run.peak_to_peak,
        }
        for item in verdicts
    ]
    facts = {
        "device": device_text(settings.device),
        "fastest": FASTEST_HZ,
        "average": settings.moving_average_ms,
        "push": PUSH_MM,
        "push_s": PUSH_S,
        "duration": DURATION_S,
        "limit": settings.output_limit,
    }
    effects = (
        "Models with effects are analysed through their linearisations, within the positions that they were fitted to, "
        f"±{REACH_MM:g} mm where these are not known, and simulated as their FMUs."
    )
    notes = [effects] if any(item.model.reach for item in verdicts) else []
    return table_from_schema(
        "tissue/haptics", "rendering", rows, source_label, facts, notes=[*notes, *refused]
    )


def device_text(device: DeviceSettings) -> str:
    """Describe device and hand in one sentence."""
    hand = f"{device.hand_stiffness_N_m:g} N/m"
    hand += f", {device.hand_damping_N_s_m:g} N·s/m" if device.hand_damping_N_s_m else ""
    hand += f", {device.hand_mass_kg:g} kg" if device.hand_mass_kg else ""
    friction = f", {device.friction_N:g} N of dry friction" if device.friction_N else ""
    delay = f", forces {device.delay_ms:g} ms late" if device.delay_ms else ""
    return (
        f"Device: {device.mass_kg:g} kg, {device.damping_N_s_m:g} N·s/m{friction}, servo at {device.rate_Hz:g} Hz, "
        f"encoder of {device.encoder_um:g} µm{delay}; hand: {hand}."
    )


def finite(value: float) -> float | None:
    """Return a number for a table cell; None (an empty cell) if it is infinite."""
    return value if math.isfinite(value) else None


_ANSWERS = {True: "yes", False: "NO"}
_ADVICE = (
    "raise runtime.rate_Hz, export a passive model (runtime/passive_models.json of the study), bound the force "
    "(runtime.device_damping), or take a device with more damping; 'lumbar render' says what helps"
)


def judge_on_device(
    models: Sequence[ExportModel], settings: RuntimeSettings, fitted: Sequence[FittedModel]
) -> list[ExportModel]:
    """Judge the models on the device, write the verdicts to their ``on_device``, and warn of unsafe models.

    ``settings.device.unsafe`` decides if an unstable loop is a warning or an error; `fitted` are the models before the export.

    Raises
    ------
    NumericalError
        If a loop is unstable and ``unsafe`` is ``"refuse"``.
    """
    device, judged, unsafe = settings.device, [], []
    for model, source in zip(models, fitted, strict=True):
        if not is_renderable(model):
            judged.append(model)
            continue
        verdict = judge_loop(model, settings, source)
        sentences = [device_text(device)]
        # The bound holds if each force acts from its own sample to the next one.
        is_prompt = verdict.analysis.is_in_step and not device.delay_ms
        is_bounded = 0.0 < model.guards.device_damping <= device.damping_N_s_m and is_prompt
        if is_bounded:
            sentences.append(
                "The bound by device_damping, which the analysis leaves out, keeps the device passive whatever it says."
            )
        if not (verdict.safe or (is_bounded and verdict.run.calm)):
            unsafe.append(verdict)
        # Without feed-through a client reads the same force with event mode and without.
        reading = "In event mode" if model.feedthrough else "However it is read"
        sentences.append(f"{reading}: {verdict.finding}.")
        if model.feedthrough:
            late = loop_sentence(analyse(render_model(model, device, late=True), device))
            sentences.append(f"Read as FMI 2.0 reads, the position set after, by the analysis: {late}.")
        judged.append(replace(model, on_device=tuple(sentences)))
    if unsafe:
        text = "\n".join(f"  {verdict.finding}" for verdict in unsafe)
        if device.unsafe == "refuse":
            raise NumericalError(
                f"not safe on the device of runtime.device, not exported:\n{text}\n{_ADVICE}, or set runtime.device.unsafe: "
                "warn"
            )
        print(f"WARNING: not safe on the device of runtime.device:\n{text}\n  {_ADVICE}", file=sys.stderr)
    return judged
