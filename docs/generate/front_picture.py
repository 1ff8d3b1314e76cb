"""The picture of the README, ``docs/images/front.png``: two hidden effects of the default study, added one after the other."""

from __future__ import annotations

from pathlib import Path

import lumbar
from lumbar.publishing.figures import style
from lumbar.tissue.diagnosis.selection.sentences import readable

ROOT = Path(__file__).resolve().parents[2]
RECORDS = ROOT / "results" / "thesis" / "twin" / "two_hidden_effects"
UNSEEN, SHOWN = "noise", (3.0, 5.5)
"""Record, not among those fitted, and its seconds that are drawn."""


@style.house_style
def main(records: Path = RECORDS, picture: Path = ROOT / "docs" / "images" / "front.png") -> None:
    """Draw measured and simulated force, and what the model leaves of it, effect by effect."""
    diagnosis = lumbar.diagnose(lumbar.read(records))
    record = next(item for item in diagnosis.records if item.name == UNSEEN)
    path, floor = diagnosis.result.path, diagnosis.result.noise_rms
    shown = (record.time >= SHOWN[0]) & (record.time <= SHOWN[1])
    figure, axes = style.new_figure(
        10.0, 3.2, nrows=2, ncols=len(path), sharex=True, sharey="row", height_ratios=(1.8, 1)
    )
    for step, (above, below) in zip(path, axes.T, strict=True):
        color = (style.WITH_EFFECTS if step.effects else style.MODELS["KB"])["color"]
        label = "with effects" if step.effects else "Kelvin–Boltzmann model"
        simulated = diagnosis.refine(step.effects).model.simulate(record)
        measured = record["output"]
        above.plot(record.time[shown], measured[shown], color=style.MEASURED, label="measured")
        above.plot(record.time[shown], simulated[shown], color=color, linestyle=(0, (4, 1.2)), label=label)
        added = readable(step.effects[-1]).replace("coulomb", "Coulomb") if step.effects else ""
        name = f"+ {added}" if added else "Kelvin–Boltzmann model"
        above.set_title(f"{name}: error {step.unseen_rms[UNSEEN]:.2g} N", fontsize=10)
        below.axhspan(-2 * floor, 2 * floor, color="#cccccc", linewidth=0, label="± 2 × noise floor")
        below.plot(record.time[shown], (measured - simulated)[shown], color=color, linewidth=0.9)
        below.set_xlabel("Time (s)")
    axes[0, 0].set_ylabel("Force (N)")
    axes[1, 0].set_ylabel("Residual (N)")
    # One entry for every colour, above all panels.
    entries = {
        label: handle
        for axis in axes.T.flat
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=4)
    figure.supxlabel("Data: synthetic twin", x=0.995, ha="right", fontsize=6, color="#555555")
    figure.savefig(picture, dpi=160)


if __name__ == "__main__":
    main()
