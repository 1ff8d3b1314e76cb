"""Tables 2.1 and 3.1 of the thesis, definitions and errors of the models, and the table of their physical parameters."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lumbar.tables.table import Table
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
    in_words,
)

if TYPE_CHECKING:
    from lumbar.settings.tissue import TissueSettings


def table_2_1(data: str, pictures: Sequence[str] = ()) -> Table:
    """Table 2.1: the viscoelastic models, from their definitions.

    Parameters
    ----------
    pictures : sequence of str
        Of the mechanical analogues, in the order of `TABLE_2_1`: texts of SVG files, shown in HTML.
    """
    import pandas as pd

    frame = pd.DataFrame(
        {
            "name": model.title,
            "mechanical_analogue": in_words(model.network),
            "equation": model.equation,
            "parameter_definition": ", ".join(model.relations) or "–",
            "references": model.references,
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
            "references": "who described it first; in brackets the thesis's own references",
            "discrete_transfer_function": "ramp-invariant form: exact at the samples of a motion in ramps",
            "proper": "whether the discrete transfer function needs no future position (Eq. 3.5)",
            "static_force": "whether a held position meets a force, H(z = 1) ≠ 0",
        },
        notes=(
            f"{MW.name}, Eq. 3.3 of the thesis, {MW.transfer}, is not the Maxwell model of this table: "
            f"{MW.no_parameters_because}.",
            f"References: {'; '.join(REFERENCES)}.",
        ),
        pictures={"mechanical_analogue": tuple(pictures)} if pictures else {},
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


_ROWS = (MW.name, MAXWELL.name, KB.name, HO.name, LE.name)
"""Order of the rows within each training record and estimator: the thesis's, with Maxwell and LE more."""


def table_3_1(models: list[FittedModel], settings: TissueSettings, data: str) -> Table:
    """Table 3.1: error metrics of all models; the thesis's rows are MW, KB, HO with estimator ``arx``.

    Parameters
    ----------
    models : list of FittedModel
        Those of the first training record first, and so on; all with the same number of unseen records.
    """
    import pandas as pd

    unit = models[0].output.unit
    trained_on = list(dict.fromkeys(model.trained_on for model in models))
    estimators = (ARX, OUTPUT_ERROR, GIVEN)
    ordered = sorted(
        models,
        key=lambda model: (
            trained_on.index(model.trained_on),
            estimators.index(model.estimator),
            _position(model),
        ),
    )
    frame = pd.DataFrame(_row(model, unit) for model in ordered)
    numbers = len(models[0].scores.tests)
    printed = (frame["estimator"] == ARX) & frame["model"].isin((MW.name, KB.name, HO.name))
    return Table(
        title="Table 3.1: error metrics of the tissue models.",
        frame=frame,
        data=data,
        definitions=_definitions(unit, numbers, settings),
        notes=_notes(settings),
        decimals=_decimals(unit, numbers),
        may_be_empty=frozenset(frame.columns)
        - {"trained_on", "model", "order", "estimator", "stable", "parameters", "rank"},
        first=tuple(frame.columns[: frame.columns.get_loc("estimator")]),  # the thesis's columns and rows
        first_rows=tuple(printed.to_numpy().nonzero()[0]),
    )


def _position(model: FittedModel) -> int:
    """Place of a row; models with effects added come after those of the thesis."""
    order = (*_ROWS, IL.name)
    return order.index(model.name) if model.name in order else len(order)


def unit_slug(unit: str) -> str:
    """Return the unit as part of a column name: ``"N·m"`` becomes ``"N_m"``."""
    return re.sub(r"[^A-Za-z0-9]+", "_", unit).strip("_")


def _row(model: FittedModel, unit: str) -> dict:
    scores = model.scores
    return {
        "trained_on": model.trained_on,
        "model": model.name,
        "order": model.order,
        "condition_number": scores.condition_number,
        "vaf_percent": scores.vaf_percent,
        "mru_percent": scores.mru_percent,
        "fit_percent": scores.fit_percent,
        f"mean_residual_{unit_slug(unit)}": scores.mean_residual,
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


def _definitions(unit: str, tests: int, settings: TissueSettings) -> dict[str, str]:
    free = "free run from the input alone, on demeaned signals, from where the start has settled (tissue.settling_s)"
    numbers = range(1, tests + 1)
    return {
        "trained_on": "record the model was fitted to (IL: judged on)",
        "model": (
            "MW: Eq. 3.3 as published; Maxwell: spring and dashpot in series of Table 2.1; KB: Eq. 3.4; "
            "HO: Eq. 3.9; LE: linear elastic; IL: inverted linear, not identified"
        ),
        "order": "poles of the discrete transfer function",
        "condition_number": (
            "Eq. 3.14; signals demeaned, every column divided by its root mean square; arx: of the "
            "regressors, output_error: of the sensitivities at the minimum; empty where rank deficient"
        ),
        "vaf_percent": f"Eq. 3.12, %; {free}",
        "mru_percent": (
            "Eqs 3.15 and 3.16, %; assumes exact regressors and white residuals: biased for arx on noisy "
            "output"
        ),
        "fit_percent": f"Eq. 3.11, %; {free}",
        f"mean_residual_{unit_slug(unit)}": f"Eq. 3.10, mean |y − ŷ| in {unit}; {free}",
        "nmse_train": "Eq. 3.13; one-step-ahead prediction from measured past forces, on the training record",
        **{f"nmse_test_{n}": f"Eq. 3.13; one-step-ahead, on test record {n}" for n in numbers},
        "alpha": "ridge coefficient of Eq. 3.7 for the standardised columns; empty where none is used",
        "estimator": (
            "arx: one-step-ahead error (Eq. 3.8), the thesis's way; output_error: free-run error; "
            "given: prescribed, not fitted"
        ),
        "stable": "whether all poles lie inside the unit circle; an unstable model has no free run",
        "biproper": "whether the present position acts at once, b of z⁰ in H(z) is not 0; else strictly proper",
        "parameters": "free coefficients",
        "rank": (
            "numerical rank of the (arx) regressors or (output_error) sensitivities; below parameters: "
            "not identifiable"
        ),
        "mru_bootstrap_percent": (
            f"MRU with σ as half the central 68 % of {settings.bootstrap.resamples} block-bootstrap "
            f"resamples, blocks of {settings.bootstrap.block_s:g} s, %"
        ),
        **{
            f"vaf_test_{n}_percent": f"Eq. 3.12, %; free run on test record {n}, less its own mean"
            for n in numbers
        },
        "test_records": "names of the test records, in the order of their numbers",
        "remark": "what is particular about the row",
    }


def _notes(settings: TissueSettings) -> tuple[str, ...]:
    search, ridge = settings.search, settings.ridge
    picked = {"training": "the training record", "test": "the other records (mean)"}[search.selection]
    return (
        f"Every model and α is picked by the %VAF of the free run on {picked}; α is 0 or one of "
        f"{ridge.alpha_points} values from {ridge.alpha_min:g} to {ridge.alpha_max:g} in geometric "
        "progression.",
        f"HO: orders 2 to {search.order_max}, strictly proper and biproper, condition number up to "
        f"{search.condition_max:g}; its output-error fit has the structure that arx picked. A remark names an optimum at the "
        f"edge of the grid, and a lower order within {NEGLIGIBLE_POINTS:g} points of its %VAF.",
        "Free runs start from rest at the first position. NMSE and %VAF are not comparable: one step ahead "
        "against a free run.",
    )


def _decimals(unit: str, tests: int) -> dict[str, int]:
    two = ["condition_number", "vaf_percent", "mru_percent", "fit_percent", "alpha", "mru_bootstrap_percent"]
    two += [f"vaf_test_{n}_percent" for n in range(1, tests + 1)]
    three = ["nmse_train", *(f"nmse_test_{n}" for n in range(1, tests + 1))]
    return {**dict.fromkeys(two, 2), **dict.fromkeys(three, 3)} | (
        {f"mean_residual_{unit_slug(unit)}": 2} if unit == "N" else {}
    )
