"""Table 2.1 and the table of physical parameters, from the definitions of the models."""

from __future__ import annotations

from lumbar.tables.table import Table
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import OUTPUT_ERROR
from lumbar.tissue.models.tissue_models import KB, KV, LE, MAXWELL, MW, TABLE_2_1, in_words


def table_2_1(data: str) -> Table:
    """Table 2.1: the viscoelastic models, from their definitions."""
    import pandas as pd

    frame = pd.DataFrame(
        {
            "name": model.title,
            "mechanical_analogue": in_words(model.network),
            "equation": model.equation,
            "parameter_definition": ", ".join(model.relations) or "–",
            "discrete_transfer_function": model.transfer,
            "proper": "no" if model is KV else "yes",
            "static_force": "no" if model is MAXWELL else "yes",
        }
        for model in TABLE_2_1
    )
    return Table(
        title="Table 2.1: spring–dashpot models of tissue force feedback.",
        frame=frame,
        data=data,
        definitions={
            "name": "name of the model",
            "mechanical_analogue": "springs (stiffness k) and dashpots (viscosity b) it is made of",
            "equation": "force f from position x; f' and x' are time derivatives",
            "parameter_definition": "coefficients of the equation from the mechanical elements",
            "discrete_transfer_function": "ramp-invariant form: exact at the samples of a motion in ramps",
            "proper": "whether the discrete transfer function needs no future position (Eq. 3.5)",
            "static_force": "whether a held position meets a force, H(z = 1) ≠ 0",
        },
        notes=(
            f"{MW.name}, Eq. 3.3 of the thesis, {MW.transfer}, is not the Maxwell model of this table: "
            f"{MW.no_parameters_because}.",
        ),
    )


def physical_parameters_table(models: list[FittedModel], confidence: float, data: str) -> Table:
    """Parameters of all models that have any by the thesis, and the reason where they are refused."""
    import pandas as pd

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
    return Table(
        title="Physical parameters of the viscoelastic models.",
        frame=frame,
        data=data,
        definitions={
            "trained_on": "record the model was fitted to",
            "model": f"{LE.name}, {MAXWELL.name} or {KB.name} of Table 2.1, or a base with effects added",
            "estimator": "arx or output_error, see Table 3.1",
            "parameter": "of the base or effect, or an element of Table 2.1; alpha of Maxwell is b/k",
            "effect": "effect it belongs to; empty: the base's own",
            "derived": "True: an element of Table 2.1, which follows from the base's parameters",
            "value": (
                "from the discrete coefficients by the inverse of the ramp-invariant discretisation; of a base with "
                "effects as fitted"
            ),
            "low": f"lower end of the {100 * confidence:g} % block-bootstrap interval; with effects: 95 %, by covariance",
            "high": "upper end of the same interval",
            "unit": "unit of value, low and high",
            "refused": "why there are no physical parameters",
        },
        notes=(
            "The intervals hold sampling error. They do not hold the bias of arx, which takes the noise of "
            "past forces for a fast relaxation; output_error has no such bias.",
        ),
        may_be_empty=frozenset(columns) - {"trained_on", "model", "estimator"},
        first=("trained_on", "model", "estimator", "parameter", "value", "low", "high", "unit"),
        first_rows=tuple(unbiased.to_numpy().nonzero()[0]),
    )
