"""What a set of records would have shown: how large an effect must be to be seen in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, nonlinear_starts
from lumbar.tissue.diagnosis.fitting.uncertainty import added_forces, beyond, tangent_basis
from lumbar.tissue.diagnosis.selection.null_distribution import NullDistribution
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL
from lumbar.tissue.diagnosis.selection.ties import noise_rms
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.models.form import Effect, Form

_STARTS = 3
"""Starting nonlinear parameters tried of every form: the first, the middle and the last of its grid."""


@dataclass(frozen=True)
class Detectable:
    """Smallest effect that the training record would show."""

    effect: str
    easiest: float
    hardest: float
    """`easiest`, `hardest`: RMS of the force it must add, in the output's unit, for the form and shape that the record
    shows best and worst."""


def threshold_ratio(null: NullDistribution, forms: int) -> float:
    """Smallest likelihood-ratio statistic that an effect may be selected on: its probability is `LEVEL`."""
    candidates = np.linspace(0.0, 4 * null.ratios[-1], 4001)
    probabilities = np.array([null.p_value(ratio, forms) for ratio in candidates])
    return float(candidates[np.argmax(probabilities <= LEVEL)])


def detectable_effects(
    diagnosis: Verdict, catalogue: dict[str, Effect], null: NullDistribution
) -> list[Detectable]:
    """Smallest detectable force of every effect that the model does not have, the best shown first.

    An effect is selected when its statistic N R² exceeds the threshold of the null table; R² counts only what the model's own
    parameters cannot take up. A force of which they take up the share 1 − s must therefore have the RMS σ √(threshold/(N s)).
    Effects that are no force beside the tissue's are judged by the change they make at their starting nonlinear parameters.
    """
    fit, data = diagnosis.model.fit, diagnosis.experiment.training
    forms = sum(len(effect.forms) for effect in catalogue.values())
    least = noise_rms(diagnosis) * np.sqrt(threshold_ratio(null, forms) / data.size)
    basis = tangent_basis(fit, [data])
    found = []
    for effect in catalogue.values():
        if effect.name in diagnosis.selected:
            continue
        shares = [share for form in effect.forms for share in _shares_left(fit, form, data, basis)]
        if shares:
            found.append(
                Detectable(
                    effect.name, *(float(least / np.sqrt(part)) for part in (max(shares), min(shares)))
                )
            )
    return sorted(found, key=lambda item: item.easiest)


_NOTHING = 1e-9
"""A share of the force that is left by rounding alone."""


def _shares_left(fit: Fit, form: Form, data: FitData, basis: np.ndarray) -> list[float]:
    """Share of a form's force, in squares, that the model cannot take up, for several nonlinear parameters."""
    residual = data.force - fit.simulate(data.motion)
    starts = nonlinear_starts(form, data, residual)
    chosen = [starts[index] for index in sorted({0, len(starts) // 2, len(starts) - 1})][:_STARTS]
    shares = []
    for start in chosen:
        for signal in added_forces(fit, form, data, start).T:
            energy = float(signal @ signal)
            left = beyond(basis, signal)
            if energy > 0 and left @ left > _NOTHING * energy:
                shares.append(float(left @ left) / energy)
    return shares
