"""Figures of the exported models."""

from __future__ import annotations

import itertools

import numpy as np

from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MODELS,
    SERIES,
    house_style,
    label_panels,
    new_figure,
)


@house_style
def fmu_force_figure(
    time: np.ndarray,
    inputs: np.ndarray,
    outputs: dict[tuple[str, str], np.ndarray],
    detail: str,
    input_label: str,
    output_label: str,
):
    """Draw the outputs of all FMUs to one push, and the delay of FMI 2.0 for one model.

    Parameters
    ----------
    time : numpy.ndarray, shape (samples,)
        Seconds.
    inputs : numpy.ndarray, shape (samples,)
    outputs : dict of tuple (str, str) to numpy.ndarray, each of shape (samples,)
        By model and FMI version, ``"2.0"`` or ``"3.0"``.
    detail : str
        Model drawn in both versions.
    input_label, output_label : str
        Axis labels with units.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, (movement, force, zoom) = new_figure(DOUBLE_COLUMN, 2.6, ncols=3, width_ratios=[0.8, 1.2, 1.2])
    movement.plot(time, inputs, color="#000000")
    movement.set(xlabel="Time (s)", ylabel=input_label)
    spare = itertools.cycle(SERIES)
    for name, version in outputs:
        if version == "3.0":
            look = MODELS.get(name, {"color": next(spare), "linestyle": "-"})
            drawn = {key: look[key] for key in ("color", "linestyle")}
            force.step(time, outputs[name, version], where="post", label=name, **drawn)
    force.set(xlabel="Time (s)", ylabel=output_label)
    force.legend(ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), columnspacing=1.0)
    shown = _around_largest_difference(outputs[detail, "2.0"], outputs[detail, "3.0"])
    for version, look in (
        ("3.0", {"marker": "o", "linestyle": "-"}),
        ("2.0", {"marker": "s", "linestyle": "--"}),
    ):
        colour = "#0072B2" if version == "3.0" else "#D55E00"
        label = "FMI 3.0, event mode" if version == "3.0" else "FMI 2.0"
        zoom.step(
            time[shown],
            outputs[detail, version][shown],
            where="post",
            color=colour,
            markersize=3,
            label=label,
            **look,
        )
    zoom.set(
        xlabel="Time (s)", ylabel=f"{output_label.split(' (')[0]} of {detail} ({output_label.split(' (')[-1]}"
    )
    zoom.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
    label_panels((movement, force, zoom))
    return figure


def _around_largest_difference(first: np.ndarray, second: np.ndarray) -> slice:
    samples = 20
    centre = int(np.abs(first - second).argmax())
    start = min(max(0, centre - samples // 2), max(0, len(first) - samples))
    return slice(start, start + samples)
