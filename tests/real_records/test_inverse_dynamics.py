"""The positioning axis by the method of its publication: its parameters lie in the intervals of the refined model."""

import numpy as np
import pytest
from data_sets import positioning_axis
from record_judging import expectations
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

from answers import absent
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings, prepare_for
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure

PARAMETERS = ("mass", "viscosity", "coulomb_force")


@pytest.fixture
def folder(shared):
    """Return the folder of the recordings."""
    if words := absent(shared / "real" / "positioning_axis", "real_records"):
        pytest.skip(words)
    return shared / "real"


def inverse_dynamics(folder) -> dict[str, float]:
    """M, Fv and Fc of M q̈ + Fv q̇ + Fc sign q̇ + c = F by least squares on filtered derivatives, in N, mm and s.

    Gautier's inverse dynamic identification model: zero-phase Butterworth filter, central differences, the regressors and the
    force through one filter more (Janot, Gautier and Brunot 2019).
    """
    data = loadmat(folder / "positioning_axis" / "DATA_EMPS.mat", squeeze_me=True)
    step = float(np.median(np.diff(data["t"])))
    low_pass = butter(4, 80.0, fs=1 / step)
    position = filtfilt(*low_pass, 1000.0 * data["qm"])
    speed = np.gradient(position, step)
    columns = np.column_stack([np.gradient(speed, step), speed, np.sign(speed), np.ones(len(speed))])
    force = filtfilt(*low_pass, data["gtau"] * data["vir"])
    inside = slice(100, -100)  # ends that the filters see by half
    found, *_ = np.linalg.lstsq(filtfilt(*low_pass, columns, axis=0)[inside], force[inside], rcond=None)
    return dict(zip(PARAMETERS, found, strict=False))


def test_inverse_dynamics_gives_the_published_parameters(folder):
    published = expectations()["positioning_axis"].parameters
    assert inverse_dynamics(folder) == pytest.approx({name: published[name] for name in PARAMETERS}, rel=0.01)


def test_intervals_hold_the_parameters_of_inverse_dynamics(folder):
    """What friction leaves depends on the stroke: intervals as of white noise are a third as wide."""
    records, keywords = positioning_axis(folder)
    prepared = prepare_for(list(records), DiagnosisSettings(**keywords)).without_whitening()
    fit = fit_base(Structure(BASES["KV"]), prepared.training)
    for effect in ("inertia", "coulomb_friction"):
        fit = add(fit, TISSUE[effect].forms[0], prepared.training)
    found = {item.name: item for item in estimates(fit, prepared.training, "mm", "N")}
    for name, value in inverse_dynamics(folder).items():
        assert found[name].low < value < found[name].high, name
        assert found[name].high - found[name].low < 0.2 * found[name].value, name
