"""Tables 2.1 and 3.1 of the thesis, definitions and errors of the models, and the table of their physical parameters."""

import re
from collections.abc import Sequence

import pandas as pd

from lumbar.settings.tissue import TissueSettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.identification.arx_search import NEGLIGIBLE_POINTS
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import ARX, GIVEN, OUTPUT_ERROR
from lumbar.tissue.models.tissue_models import (
    HO,
    IL,
    KB,
    KV,
    LE,
    MAXWELL,
    MW,
    REFERENCES,
    TABLE_2_1,
    describe_network,
)


def table_2_1(source_label: str, pictures: Sequence[str] = ()) -> Table:
    """Table 2.1: the viscoelastic models, from their definitions.

    `pictures` are those of the mechanical analogues, in the order of `TABLE_2_1`: texts of SVG files, shown in HTML.
    """
    frame = pd.DataFrame(
        {
            "name": model.title,
            "mechanical_analogue": describe_network(model.network),
            "equation": model.equation,
            "parameter_definition": ", ".join(model.relations) or "–",
            "references": model.references,
            "discrete_transfer_function": model.transfer,
            "proper": "no" if model is KV else "yes",
            "static_force": "no" if model is MAXWELL else "yes",
        }
        for model in TABLE_2_1
    )
    words = {
        "MW": MW.name,
        "MW_transfer": MW.transfer,
        "MW_because": MW.no_parameters_because,
        "references": "; ".join(REFERENCES),
    }
    shown = {"mechanical_analogue": tuple(pictures)} if pictures else {}
    return table_from_schema("tissue/identification", "table_2_1", frame, source_label, words, pictures=shown)


def physical_parameters_table(models: list[FittedModel], confidence: float, source_label: str) -> Table:
    """Parameters of all models that have any by the thesis, and the reason where they are refused."""
    rows = []
    for model in models:
        if model.base not in BASES:
            continue
        head = {"trained_on": model.trained_on, "model": model.name, "estimator": model.estimator}
        for item in model.parameters:
            found = {key: getattr(item, key) for key in ("value", "low", "high", "unit")}
            of = {"effect": item.effect or None, "derived": item.derived}
            rows.append({**head, "parameter": item.name, **of, **found, "refused": None})
        if model.no_parameters_because:
            rows.append({**head, "refused": model.no_parameters_because})
    columns = ["trained_on", "model", "estimator", "parameter", "effect", "derived"]
    columns += ["value", "low", "high", "unit", "refused"]
    frame = pd.DataFrame(rows, columns=columns)
    unbiased = frame["derived"].eq(True) & (frame["estimator"] == OUTPUT_ERROR)
    return table_from_schema(
        "tissue/identification",
        "physical_parameters",
        frame,
        source_label,
        {"percent": 100 * confidence},
        first_rows=tuple(unbiased.to_numpy().nonzero()[0]),
    )


_ROWS = (MW.name, MAXWELL.name, KB.name, HO.name, LE.name)
"""Order of the rows within each training record and estimator: the thesis's, with Maxwell and LE more."""


def table_3_1(models: list[FittedModel], settings: TissueSettings, source_label: str) -> Table:
    """Table 3.1: error metrics of all models; the thesis's rows are MW, KB, HO with estimator ``arx``.

    Models of the first training record come first, and so on; all have the same number of unseen records.
    """
    unit = models[0].output.unit
    trained_on = list(dict.fromkeys(model.trained_on for model in models))
    estimators = (ARX, OUTPUT_ERROR, GIVEN)
    # Models with effects added come after those of the thesis.
    place = {name: index for index, name in enumerate((*_ROWS, IL.name))}
    ordered = sorted(
        models,
        key=lambda model: (
            trained_on.index(model.trained_on),
            estimators.index(model.estimator),
            place.get(model.name, len(place)),
        ),
    )
    frame = pd.DataFrame(_row(model, unit) for model in ordered)
    printed = (frame["estimator"] == ARX) & frame["model"].isin((MW.name, KB.name, HO.name))
    words = {
        "unit": unit,
        "free": "free run from the input alone, on demeaned signals, from where the start has settled (tissue.settling_s)",
        "resamples": settings.bootstrap.resamples,
        "block_s": settings.bootstrap.block_s,
        "picked": {"training": "the training record", "test": "the other records (mean)"}[
            settings.search.selection
        ],
        "ridge": settings.ridge,
        "search": settings.search,
        "negligible": NEGLIGIBLE_POINTS,
    }
    return table_from_schema(
        "tissue/identification",
        "table_3_1",
        frame,
        source_label,
        words,
        decimals={"mean_residual_N": 2} if unit == "N" else {},
        first_rows=tuple(printed.to_numpy().nonzero()[0]),  # the thesis's rows
    )


def _row(model: FittedModel, unit: str) -> dict:
    scores = model.scores
    unit_in_column = re.sub(r"[^A-Za-z0-9]+", "_", unit).strip("_")  # "N·m" as "N_m"
    return {
        "trained_on": model.trained_on,
        "model": model.name,
        "order": model.order,
        "condition_number": scores.condition_number,
        "vaf_percent": scores.vaf_percent,
        "mru_percent": scores.mru_percent,
        "fit_percent": scores.fit_percent,
        f"mean_residual_{unit_in_column}": scores.mean_residual,
        "nmse_train": scores.nmse_train,
        **{f"nmse_test_{number}": value for number, value in enumerate(scores.nmse_tests, start=1)},
        "alpha": model.alpha,
        "estimator": model.estimator,
        "stable": model.stable,
        "biproper": model.structure.biproper if model.discrete else None,
        "parameters": scores.free_parameters,
        "rank": scores.rank,
        "mru_bootstrap_percent": scores.mru_bootstrap_percent,
        **{
            f"vaf_test_{number}_percent": value
            for number, value in enumerate(scores.vaf_tests_percent, start=1)
        },
        "test_records": "; ".join(scores.tests) or None,
        "remark": model.remark or None,
    }
