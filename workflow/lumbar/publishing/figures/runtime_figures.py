"""Figures of exported models: their outputs, the damping that they require of a device, and their loops with device and hand."""

import itertools
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MODELS,
    SERIES,
    house_style,
    label_panels,
    model_line,
    model_look,
    new_figure,
    note,
)
from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.loop_verdict import LoopVerdict
from lumbar.tissue.haptics.z_width import ZWidth

_FMI_LOOKS = {
    "3.0": {"label": "FMI 3.0, event mode", "marker": "o", "linestyle": "-"},
    "2.0": {"label": "FMI 2.0", "marker": "s", "linestyle": "--", "markerfacecolor": "white"},
}


@house_style
def fmu_force_figure(
    time: np.ndarray,
    inputs: np.ndarray,
    outputs: dict[tuple[str, str], np.ndarray],
    detail: str,
    input_label: str,
    output_label: str,
) -> Figure:
    """Draw the outputs of all FMUs to one push, and the delay of FMI 2.0 for one model.

    `time` in seconds and `inputs`, the position of the push, have shape (samples,), as has each of the `outputs` by model
    and FMI version, ``"2.0"`` or ``"3.0"``; `detail` is the model drawn in both versions. `input_label` and `output_label`
    have units.
    """
    figure, (movement, force, zoom) = new_figure(DOUBLE_COLUMN, 2.6, ncols=3, width_ratios=[0.8, 1.2, 1.2])
    movement.plot(time, inputs, color="#000000")
    movement.set(xlabel="Time (s)", ylabel=input_label)
    spare = itertools.cycle(SERIES)
    for name, version in outputs:
        if version == "3.0":
            color = next(spare)
            look = model_line(name) if name in MODELS else {"color": color, "linestyle": "-"}
            force.step(time, outputs[name, version], where="post", label=name, **look)
    force.set(xlabel="Time (s)", ylabel=output_label)
    force.legend(ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), columnspacing=1.0)
    # Twenty samples around the largest difference of both versions.
    centre = int(np.abs(outputs[detail, "2.0"] - outputs[detail, "3.0"]).argmax())
    start = min(max(0, centre - 10), max(0, len(time) - 20))
    shown = slice(start, start + 20)
    for version, look in _FMI_LOOKS.items():
        look = {**look, "color": model_look(detail)["color"], "markersize": 3}
        zoom.step(time[shown], outputs[detail, version][shown], where="post", **look)
    quantity, unit = output_label.split(" (")[0], output_label.split(" (")[-1]
    zoom.set(xlabel="Time (s)", ylabel=f"{quantity} of {detail} ({unit}")
    zoom.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
    label_panels((movement, force, zoom))
    return figure


@house_style
def z_width_figure(result: ZWidth, device: DeviceSettings) -> Figure:
    """Draw the damping required by models over the rate, and the Z-width of the device."""
    figure, (needed, width) = new_figure(DOUBLE_COLUMN, 3.0, ncols=2)
    for name, damping in result.needed.items():
        known = np.isfinite(damping)
        marker = {"marker": model_look(name)["marker"]} if known.sum() == 1 else {}
        needed.loglog(result.rates[known], damping[known], label=name, **model_line(name), **marker)
    needed.axhline(device.damping_N_s_m, color="#000000", linewidth=0.8)
    words, at = f"the device: {device.damping_N_s_m:g} N·s/m", (result.rates[0], device.damping_N_s_m)
    note(needed, words, at, (0, -3), va="top", fontsize=7)
    needed.set(xlabel="Rate of the model (Hz)", ylabel="Damping needed (N·s/m)")
    needed.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.02))
    for colour, (rate, (passive, stable)) in zip(SERIES, result.stiffness.items(), strict=False):
        width.loglog(result.damping, stable, color=colour, label=f"stable, {rate:.4g} Hz")
        width.loglog(result.damping, passive, color=colour, linestyle="--", label=f"passive, {rate:.4g} Hz")
    width.axvline(device.damping_N_s_m, color="#000000", linewidth=0.8)
    width.set(xlabel="Damping of the device (N·s/m)", ylabel="Largest stiffness (N/m)")
    look = {"xycoords": ("data", "axes fraction"), "ha": "right", "va": "top", "fontsize": 7}
    note(width, "the device", (device.damping_N_s_m, 1.0), (-3, -4), **look)
    width.legend(ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.02))
    for axes in (needed, width):
        axes.minorticks_off()  # their labels, all empty, would take most of the time of the figure
    label_panels((needed, width))
    return figure


@house_style
def loop_figure(verdicts: Sequence[LoopVerdict]) -> Figure:
    """Draw position and force of simulated loops side by side; at least one is needed."""
    size = {"nrows": 2, "ncols": len(verdicts), "squeeze": False}
    figure, axes = new_figure(DOUBLE_COLUMN, 3.6, sharex=True, sharey="row", **size)
    for (position, force), item in zip(axes.T, verdicts, strict=True):
        run = item.run
        colour = model_look(item.model.name)["color"]
        position.plot(run.time, 1e3 * run.position, color=colour)
        force.step(run.time, run.force, where="post", color=colour)
        for bound in (-item.model.limit, item.model.limit):
            force.axhline(bound, color="#000000", linewidth=0.6, linestyle=(0, (4, 2)))
        outcome = "runs away" if run.runs_away else "comes to rest"
        outcome = f"oscillates at {run.frequency:.1f} Hz" if run.oscillates else outcome
        position.set_title(f"{item.model.name} at {item.analysis.rate:.4g} Hz: {outcome}", loc="center")
        force.set(xlabel="Time (s)", xlim=(0.0, 1.5))
    for axis, label in zip(axes[:, 0], ("Stylus (mm)", "Force (N)"), strict=True):
        axis.set_ylabel(label)
    return figure


@house_style
def placeholder_figure(reasons: Sequence[str]) -> Figure:
    """Return a figure without a model, with the reason as text."""
    figure, axes = new_figure(DOUBLE_COLUMN, 1.5)
    axes.set_axis_off()
    text = "\n".join(textwrap.fill(reason, 110) for reason in reasons) or "no model"
    axes.text(0.0, 0.5, text, va="center", fontsize=6)
    return figure
