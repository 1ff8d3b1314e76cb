"""Models of tissue in space for the tests of FMUs: a base with turned axes, and effects in their vector form."""

import numpy as np
import scipy

from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.fmu.build.export_model import ExportModel, export_models
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import FittedParameter, Port
from lumbar.tissue.models.space import SpatialBase, Symmetry, force_sensor_effects, turn
from lumbar.tissue.models.structure import Structure

STIFFNESS, BRANCH, RELAXATION = np.array([0.8, 0.5, 0.3]), np.array([3.0, 2.0, 1.0]), 0.04
FRAME = turn(np.array([0.4, -0.3, 0.7]))
FIVE = {
    "delay/pure": ([], [0.0023]),
    "coulomb_friction/coulomb": ([0.3], [0.8]),
    "hysteresis/dahl": ([0.2], [0.15]),
    "hardening_stiffness/cubic": ([0.05], []),
    "softening/path": ([0.1], [30.0]),
}
"""As many effects as a model on a device is likely to have, each of another kind."""


def spatial_model(
    effects: dict[str, tuple[list, list]], axes: tuple[str, ...] = ("x", "y", "z")
) -> FittedModel:
    """KB with orthotropic matrices and effects: linear and nonlinear parameters by key of the form."""
    size = len(axes)
    frame = FRAME if size == 3 else turn(np.array([0.4]))
    base = SpatialBase(BASES["KB"], Symmetry.ORTHOTROPIC, axes, (tuple(frame.ravel().tolist()),), free=False)
    structure = Structure(base.structural)
    values = [("", base.structural, ([*STIFFNESS[:size], *BRANCH[:size]], [RELAXATION]))]
    for key, numbers in effects.items():
        effect, name = key.split("/")
        if effect in TISSUE:
            form = next(item for item in TISSUE[effect].to_space(axes)[0].forms if item.name == name)
        else:
            (form,) = force_sensor_effects(axes)[effect].forms
        structure = structure.with_form(form)
        values.append((effect, form, numbers))
    parameters = [
        FittedParameter(item.name, item.symbol, item.unit, value, effect=effect)
        for effect, part, numbers in values
        for items, given in zip((part.linear, part.nonlinear), numbers, strict=True)
        for item, value in zip(items, given, strict=True)
    ]
    return FittedModel(
        name="+".join(["orthotropic_KB", *(effect for effect, *_ in values[1:])])[:100],
        structure=structure,
        sampling_time=0.001,
        input=Port("position", "mm"),
        output=Port("force", "N"),
        base="KB",
        parameters=tuple(parameters),
    )


def spatial_export(effects: dict[str, tuple[list, list]], axes=("x", "y", "z"), **settings) -> ExportModel:
    """The same ready for export at 1 kHz."""
    given = {"rate_Hz": 1000.0, "moving_average_ms": 0, "start": "first_position", **settings}
    return export_models([spatial_model(effects, axes)], RuntimeSettings(**given))[0]


def integrated(positions: np.ndarray, step: float) -> np.ndarray:
    """Forces of KB with `FIVE`, written out: states by SciPy's matrix exponential over straight lines, (samples, axes)."""
    (delay,), (coulomb, speed), (limit, distance), (cubic,), (lost, path) = (
        [*linear, *nonlinear] for linear, nonlinear in FIVE.values()
    )
    whole, share = divmod(delay / step, 1.0)
    held = np.concatenate([np.repeat(positions[:1], int(whole) + 1, axis=0), positions])
    z = (share * held[:-1] + (1.0 - share) * held[1:])[: len(positions)]
    dz = np.diff(z, axis=0, prepend=z[:1])
    v, size = dz / step, np.linalg.norm(dz, axis=1) / step
    q, r = np.zeros_like(z), np.zeros_like(z)
    for k in range(1, len(z)):
        q[k] = _linear_step(1.0 / RELAXATION, v[k], q[k - 1], step)
        r[k] = _linear_step(size[k] / distance, v[k] / distance, r[k - 1], step)
    spring, branch = ((FRAME * along) @ FRAME.T for along in (STIFFNESS, BRANCH))
    direction = v / np.where(size > 0, size, 1.0)[:, None]
    friction = coulomb * np.tanh(size / speed)[:, None] * direction + limit * r
    hardening = cubic * np.sum(z**2, axis=1, keepdims=True) * z
    softening = lost * np.expm1(-np.cumsum(size * step) / path)[:, None] * z
    return z @ spring + q @ branch + friction + hardening + softening


def _linear_step(decay: float, driven: np.ndarray, before: np.ndarray, step: float) -> np.ndarray:
    """State of ẋ = u − λx a step later."""
    matrix = scipy.linalg.expm(step * np.array([[-decay, 1.0], [0.0, 0.0]]))
    return matrix[0, 0] * before + matrix[0, 1] * driven
