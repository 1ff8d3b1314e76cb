"""A refined model beside the identified ones: its row of Table 3.1 and its entry in ``models.json``."""

from __future__ import annotations

import numpy as np

from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.diagnosis.fitting.fit_data import FitData
from lumbar.diagnosis.selection.forward_selection import Candidate
from lumbar.diagnosis.selection.refine import refine
from lumbar.diagnosis.selection.refined_model import model_entry
from lumbar.identification.identify_tissue import OUTPUT_ERROR
from lumbar.identification.metrics import fit_ratio, mean_residual, variance_accounted_for
from lumbar.records.record import Record


def refined_fit(records: list[Record], effects: list[str], settings: DiagnosisSettings) -> dict:
    """Refine a base model and describe it as `lumbar.identification.identify_tissue.identify` describes its fits.

    One-step errors, ridge and condition number belong to difference equations and are left empty.

    Parameters
    ----------
    records : list of Record
    effects : list of str
        Effects to add to the base.
    settings : DiagnosisSettings
        ``train`` names the training record.

    Returns
    -------
    dict
    """
    experiment, ladder = refine(records, effects, settings)
    model = ladder[-1]
    entry = model_entry(model, experiment)
    trained = _scores(model, experiment.training)
    relative = [
        100 * (item["high"] - item["low"]) / (2 * 1.96 * abs(item["value"]))
        for item in entry["parameters"]
        # One at its bound 0, to rounding, has no relative uncertainty.
        if abs(item["value"]) > 1e-8 * max(abs(item["low"]), abs(item["high"]))
    ]
    return {
        **entry,
        "parameters": len(entry["parameters"]),
        "estimator": OUTPUT_ERROR,
        "order": 1 if model.fit.structure.base.nonlinear else 0,
        "input_lags": [],
        "numerator": None,
        "denominator": None,
        "stable": True,
        "rank": len(entry["parameters"]),
        "condition_number": None,
        "alpha": None,
        **trained,
        "mru_percent": max(relative),
        "mru_bootstrap_percent": None,
        "nmse_train": None,
        "nmse_tests": [None] * len(experiment.tests),
        "vaf_tests_percent": [_scores(model, test)["vaf_percent"] for test in experiment.tests],
        "physical": {
            item["name"]: {key: item[key] for key in ("value", "unit", "low", "high")}
            for item in entry["parameters"]
        },
        "physical_refused": "",
        "remark": "base and effects fitted together by free-run simulation error",
    }


def _scores(model: Candidate, data: FitData) -> dict:
    """VAF, FIT and mean residual of the free run, both signals about their means as for the other models."""
    measured, simulated = data.settled(data.force), data.settled(model.fit.simulate(data.motion))
    measured, simulated = measured - np.mean(measured), simulated - np.mean(simulated)
    return {
        "vaf_percent": variance_accounted_for(measured, simulated),
        "fit_percent": fit_ratio(measured, simulated),
        "mean_residual": mean_residual(measured, simulated),
    }
