"""The models' file ``tissue/models.json``: its contents, and simulations of the models in it."""

from __future__ import annotations

from lumbar.errors import InputError, NumericalError
from lumbar.identification.arx_search import IdentificationData, free_run, one_step_nmse
from lumbar.identification.identify_tissue import GIVEN
from lumbar.models.tissue_models import IL, inverted_linear
from lumbar.models.transfer_function import TransferFunction
from lumbar.records.record import Record

_SCORES = ("vaf_percent", "fit_percent", "mean_residual", "nmse_train", "nmse_tests", "vaf_tests_percent")


def inverted_linear_fit(
    training: Record, tests: list[Record], settling_s: float, force_max: float, travel: float
):
    """Errors of the inverted linear model on the records, as a dict like those of `identify`.

    Parameters
    ----------
    training : Record
        Record beside whose models it stands.
    tests : list of Record
        The other records.
    settling_s : float
        Seconds at the start that do not count.
    force_max, travel : float
        Largest force and the travel over which it is reached, in the units of output and input.
    """
    model = inverted_linear(force_max, travel)
    data = IdentificationData.from_record(training, settling_s)
    others = [IdentificationData.from_record(test, settling_s) for test in tests]
    run = free_run(model, data)
    return {
        "name": IL.name,
        "trained_on": training.name,
        "estimator": GIVEN,
        "order": 0,
        "input_lags": [0],
        "numerator": list(model.numerator),
        "denominator": list(model.denominator),
        "input_offset": 0.0,
        "output_offset": 0.0,
        "stable": True,
        "parameters": 0,
        "rank": 0,
        "condition_number": None,
        "alpha": None,
        "vaf_percent": run.vaf_percent,
        "fit_percent": run.fit_percent,
        "mean_residual": run.mean_residual,
        "mru_percent": None,
        "mru_bootstrap_percent": None,
        "nmse_train": one_step_nmse(model, data),
        "nmse_tests": [one_step_nmse(model, other) for other in others],
        "vaf_tests_percent": [free_run(model, other).vaf_percent for other in others],
        "physical": {},
        "physical_refused": f"{IL.name}: {IL.no_parameters_because}",
        "remark": "not identified",
    }


def models_document(identified: list[dict]) -> dict:
    """Contents of ``tissue/models.json``.

    The inverted linear model is not fitted: it stands there once, with ``trained_on`` null and estimator
    ``given``.

    Parameters
    ----------
    identified : list of dict
        Results of `lumbar.identification.identify_tissue.identify`, one per training record.
    """
    first = identified[0]
    fitted = [fit for result in identified for fit in result["fits"] if fit["estimator"] != GIVEN]
    given = [fit for fit in first["fits"] if fit["estimator"] == GIVEN]
    # What a prescribed model scores on one record is no property of it.
    unscored = dict.fromkeys((*_SCORES, "trained_on"))
    models = [*fitted, *({**fit, **unscored} for fit in given)]
    return {
        "schema": "lumbar.models/1",
        "sampling_time_s": first["sampling_time_s"],
        **first["channels"],
        "models": models,
    }


def simulate_models(
    document: dict, record: Record, names: tuple[str, ...], trained_on: str, estimator: str
) -> dict:
    """Free runs of published models on a record, in the units of its output.

    Parameters
    ----------
    document : dict
        Contents of ``models.json``.
    record : Record
        Channels ``input`` and ``output``.
    names : tuple of str
        Models to simulate.
    trained_on, estimator : str
        Which of the fits.

    Returns
    -------
    dict of str to numpy.ndarray
        Simulated output by model; an unstable model is left out.

    Raises
    ------
    InputError
        If a model is not in the document.
    """
    runs = {}
    for name in names:
        matching = [
            model
            for model in document["models"]
            if (model["name"], model["trained_on"], model["estimator"]) == (name, trained_on, estimator)
        ]
        if not matching:
            raise InputError(f"models.json has no model {name} trained on {trained_on} by {estimator}")
        (model,) = matching
        transfer_function = TransferFunction(tuple(model["numerator"]), tuple(model["denominator"]))
        try:
            run = transfer_function.simulate(record["input"] - model["input_offset"])
        except NumericalError:
            continue
        runs[name] = run + model["output_offset"]
    return runs
