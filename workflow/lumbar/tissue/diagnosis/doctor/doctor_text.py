"""What could have been seen in a set of records, as a terminal shows it."""

from __future__ import annotations

from collections.abc import Sequence

from lumbar.tissue.diagnosis.doctor.doctor_tables import effect_row, fault_row, remarks
from lumbar.tissue.diagnosis.doctor.examination import Examination
from lumbar.tissue.diagnosis.selection.sentences import readable


def report(found: Examination) -> str:
    """Remarks, a table of effects, one of mistakes, and the further record that helps most."""
    parts = ["\n".join(remarks(found))]
    if found.effects:
        parts.append(_effects(found))
    if found.faults:
        parts.append(_faults(found))
    if found.further is not None:
        parts.append(found.further.sentence)
    elif found.effects:
        parts.append("No further record that was tried would show more than those at hand.")
    return "\n\n".join(parts)


def _effects(found: Examination) -> str:
    unit = found.truth.verdict.experiment.output_unit
    head = ["effect", f"named from ({unit})", "in noises", "predicted", "where strong", "where too weak"]
    rows = []
    for item in found.effects:
        row = effect_row(item, found)
        several = sum(other.form.effect == item.form.effect for other in found.effects) > 1
        name = readable(item.form.effect) + (f" ({item.form.name})" if several else "")
        rows.append(
            [
                name + ("*" if item.present is not None else ""),
                _number(row["smallest_named"]),
                _number(row["smallest_named_over_noise"]),
                _number(row["predicted_over_noise"]),
                row["said"],
                row["said_below"] or "",
            ]
        )
    lines = _aligned([head, *rows], numbers=(1, 2, 3))
    present = [item for item in found.effects if item.present is not None]
    for item in present:
        lines.append(
            f"* in your records already: {readable(item.form.effect)}, {item.present:.3g} {unit} RMS, "
            f"{(item.present or 0.0) / item.noise:.2g} times the noise"
        )
    return "\n".join(lines)


def _faults(found: Examination) -> str:
    head = ["mistake", "told down to", "not told"]
    rows = []
    for item in found.faults:
        row = fault_row(item)
        rows.append([row["mistake"], row["smallest_told"] or "–", row["not_told"] or "–"])
    return "\n".join(_aligned([head, *rows]))


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}"


def _aligned(rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> list[str]:
    """Lines with columns of one width each, numbers to the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(
            cell.rjust(width) if column in numbers else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
