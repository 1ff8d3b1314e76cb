"""The error ladder: how the error falls from the base model, effect by effect, to the noise floor."""

from __future__ import annotations

from lumbar.publishing.figures.style import MODELS, SINGLE_COLUMN, house_style, new_figure
from lumbar.tissue.diagnosis.selection.verdict import told_apart


@house_style
def ladder_figure(rungs: list[dict], unit: str, floor: float | None):
    """Draw training and unseen error of every rung, and the noise floor.

    Parameters
    ----------
    rungs : list of dict
        ``label``, ``train_rms`` and ``test_rms`` of base, base and first effect, ….
    unit : str
        Of the errors.
    floor : float or None
        Noise floor, where it is known.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(SINGLE_COLUMN, 2.6)
    places = range(len(rungs))
    style = MODELS["KB"]
    axes.bar(
        [place - 0.19 for place in places],
        [rung["train_rms"] for rung in rungs],
        0.36,
        color=style["color"],
        alpha=0.45,
        label="training record",
    )
    axes.bar(
        [place + 0.19 for place in places],
        [rung["test_rms"] for rung in rungs],
        0.36,
        color=style["color"],
        hatch="//",
        edgecolor="white",
        label="unseen records",
    )
    for shift, key in ((-0.19, "train_rms"), (0.19, "test_rms")):
        words = told_apart([rung[key] for rung in rungs], 2)
        for place, rung, told in zip(places, rungs, words, strict=True):
            axes.annotate(
                told,
                (place + shift, rung[key]),
                (0, 1),
                textcoords="offset points",
                ha="center",
                size=6,
            )
    if floor is not None:
        axes.axhline(floor, color="black", linestyle="--", linewidth=0.9, label="noise floor")
    smallest = min(
        [rung[key] for rung in rungs for key in ("train_rms", "test_rms")] + ([floor] if floor else [])
    )
    largest = max(rung[key] for rung in rungs for key in ("train_rms", "test_rms"))
    if largest > 8 * smallest:
        axes.set_yscale("log")
        axes.set_ylim(0.5 * smallest, 2.2 * largest)
    else:
        axes.set_ylim(0, 1.25 * largest)
    axes.set_xticks(list(places), [rung["label"] for rung in rungs])
    axes.set_ylabel(f"RMS of the simulation error ({unit})")
    axes.grid(visible=False, axis="x")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def ladder_rungs(diagnosis: dict) -> list[dict]:
    """Return the rungs of a ``diagnosis.json`` with labels for the figure."""
    rungs, before = [], 0
    for rung in diagnosis["ladder"]:
        added = rung["effects"][before:]
        label = diagnosis["base"] if not rung["effects"] else "+ " + " and ".join(added).replace("_", "\n")
        rungs.append({"label": label, "train_rms": rung["train_rms"], "test_rms": rung["test_rms"]})
        before = len(rung["effects"])
    return rungs
