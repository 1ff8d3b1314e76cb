"""Tables 2.1 (definitions) and 3.1 (errors) of the models of the thesis, and the table of their physical parameters."""

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
    """Return Table 2.1: the viscoelastic models, from their definitions.

    `pictures` are SVG texts of the mechanical analogues in the order of `TABLE_2_1`, shown in HTML.
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
    fields = {"MW": MW.name, "MW_transfer": MW.transfer, "MW_because": MW.no_parameters_because}
    fields["references"] = "; ".join(REFERENCES)
    shown = {"mechanical_analogue": tuple(pictures)} if pictures else {}
    return table_from_schema(
        "tissue/identification", "table_2_1", frame, source_label, fields, pictures=shown
    )


def physical_parameters_table(models: list[FittedModel], confidence: float, source_label: str) -> Table:
    """Return the physical parameters of all models, or the reason why a model has none."""
    columns = ["trained_on", "model", "estimator", "parameter", "effect", "derived"]
    columns += ["value", "low", "high", "unit", "refused"]
    rows = []
    for model in models:
        if model.base not in BASES:
            continue
        head = {"trained_on": model.trained_on, "model": model.name, "estimator": model.estimator}
        for item in model.parameters:
            row = {key: getattr(item, key) for key in ("derived", "value", "low", "high", "unit")}
            rows.append(
                {**head, "parameter": item.name, "effect": item.effect or None, **row, "refused": None}
            )
        if model.no_parameters_because:
            rows.append({**head, "refused": model.no_parameters_because})
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


_ESTIMATORS = (ARX, OUTPUT_ERROR, GIVEN)


def table_3_1(models: list[FittedModel], settings: TissueSettings, source_label: str) -> Table:
    """Return Table 3.1: error metrics of all models; the thesis's rows are MW, KB, HO with estimator ``arx``.

    Models are sorted by training record, estimator and the order of the thesis; models with effects come last. All models must
    have the same number of unseen records.
    """
    unit = models[0].output.unit
    trained_on = list(dict.fromkeys(model.trained_on for model in models))
    names = [item.name for item in (MW, MAXWELL, KB, HO, LE, IL)]

    def place(model: FittedModel) -> tuple[int, int, int]:
        number = names.index(model.name) if model.name in names else len(names)
        return trained_on.index(model.trained_on), _ESTIMATORS.index(model.estimator), number

    frame = pd.DataFrame(_row(model, unit) for model in sorted(models, key=place))
    is_printed = (frame["estimator"] == ARX) & frame["model"].isin((MW.name, KB.name, HO.name))
    fields = {
        "unit": unit,
        "free": "free run from the input alone, on demeaned signals, from where the start has settled (tissue.settling_s)",
        "resamples": settings.bootstrap.resamples,
        "block_s": settings.bootstrap.block_s,
        "picked": "the training record"
        if settings.search.selection == "training"
        else "the other records (mean)",
        "ridge": settings.ridge,
        "search": settings.search,
        "negligible": NEGLIGIBLE_POINTS,
    }
    return table_from_schema(
        "tissue/identification",
        "table_3_1",
        frame,
        source_label,
        fields,
        decimals={"mean_residual_N": 2} if unit == "N" else {},
        first_rows=tuple(is_printed.to_numpy().nonzero()[0]),
    )


def _row(model: FittedModel, unit: str) -> dict:
    scores = model.scores
    unit_in_column = re.sub(r"[^A-Za-z0-9]+", "_", unit).strip("_")  # "N·m" as "N_m"
    vaf_tests = enumerate(scores.vaf_tests_percent, start=1)
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
        **{f"vaf_test_{number}_percent": value for number, value in vaf_tests},
        "test_records": "; ".join(scores.tests) or None,
        "remark": model.remark or None,
    }
