"""Figures 3.4 and 3.5: excitation and response of the tissue, and the models' free runs."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    house_style,
    label_panels,
    model_look,
    new_figure,
)
from lumbar.records.record import Record


def _segment(record: Record, segment_s: tuple[float, float]) -> np.ndarray:
    since_start = record.time - record.time[0]
    inside = (since_start >= segment_s[0] - 1e-9) & (since_start <= segment_s[1] + 1e-9)
    if not inside.any():
        raise InputError(
            f"{record.name} lasts {record.duration:g} s: nothing lies in tissue.segment_s "
            f"[{segment_s[0]:g}, {segment_s[1]:g}]"
        )
    return inside


@house_style
def excitation_figure(records: list[Record], segment_s: tuple[float, float]):
    """Figure 3.4: a segment of input and output of every record, one panel pair each.

    Parameters
    ----------
    records : list of Record
        Channels ``input`` and ``output``.
    segment_s : (float, float)
        Seconds since the start of each record.
    """
    figure, axes = new_figure(
        DOUBLE_COLUMN, 3.4, nrows=2, ncols=len(records), sharex="col", sharey="row", squeeze=False
    )
    for column, record in zip(axes.T, records, strict=True):
        inside = _segment(record, segment_s)
        time = record.time[inside] - record.time[0]
        column[0].plot(time, record["input"][inside], color="#0072B2")
        column[1].plot(time, record["output"][inside], color=MEASURED, linewidth=0.9)
        column[1].set_xlabel("Time (s)")
        column[1].set_xlim(segment_s)
    for row, role in enumerate(("input", "output")):
        axes[row, 0].set_ylabel(records[0].channels[role].label)
    label_panels(axes[0])
    for axis, record in zip(axes[0], records, strict=True):
        axis.set_title(record.name.replace("_", " "))
    return figure


@house_style
def comparison_figure(record: Record, simulated: dict[str, np.ndarray], segment_s: tuple[float, float]):
    """Figure 3.5: measured output beside the free run of every model, and what remains of it.

    Parameters
    ----------
    record : Record
        Channels ``input`` and ``output``.
    simulated : dict of str to numpy.ndarray, shape (samples,)
        Free run by name of the model.
    segment_s : (float, float)
        Seconds since the start of the record.
    """
    inside = _segment(record, segment_s)
    time = record.time[inside] - record.time[0]
    figure, (response, residual) = new_figure(
        DOUBLE_COLUMN, 4.2, nrows=2, sharex=True, height_ratios=(2.2, 1.0)
    )
    output = record.channels["output"]
    measured = output.values[inside]
    response.plot(time, measured, color=MEASURED, linewidth=0.8, label="measured")
    for name, values in simulated.items():
        look = {key: model_look(name)[key] for key in ("color", "linestyle")}
        response.plot(time, values[inside], label=name, linewidth=1.5, **look)
        residual.plot(time, measured - values[inside], linewidth=1.0, **look)
    response.set_ylabel(output.label)
    residual.set_ylabel(f"Measured − model\n({output.unit})")
    residual.set_xlabel("Time (s)")
    residual.set_xlim(segment_s)
    response.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(simulated) + 1)
    return figure
