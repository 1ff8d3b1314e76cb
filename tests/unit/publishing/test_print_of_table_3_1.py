"""Table 3.1 against the print: what its own equations allow; the noise and delay of the twin's tissue."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lumbar.publishing.reproduction.table_cells import (
    impossible_mru,
    least_mru,
)
from lumbar.settings.twin import SyntheticTissueSettings
from lumbar.twin.tissue_recordings import tissue_force, tissue_test

QUICK = {
    "tissue": {"search": {"order_max": 2}, "ridge": {"alpha_points": 9}, "bootstrap": {"resamples": 100}},
    "signals": {"multisine": {"periods": 2}},
}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("alpha", [0.0, 30.0])
def test_no_data_give_a_smaller_mru_than_the_bound(seed, alpha):
    """Columns of any scale and correlation, ridge or none: Eqs 3.13 to 3.16 written out."""
    rng = np.random.default_rng(seed)
    rows, parameters = 400, int(rng.integers(2, 7))
    regressors = rng.standard_normal((rows, parameters)) @ rng.standard_normal((parameters, parameters))
    regressors *= 10.0 ** rng.uniform(-2, 2, parameters)
    target = regressors @ rng.standard_normal(parameters)
    target += rng.uniform(0.05, 2) * target.std() * rng.standard_normal(rows)
    gram = regressors.T @ regressors
    found = np.linalg.solve(gram + alpha**2 * np.eye(parameters), regressors.T @ target)
    square = np.sum((target - regressors @ found) ** 2)
    deviations = np.sqrt(square / (rows - parameters) * np.diag(np.linalg.inv(gram)))
    mru = 100 * np.max(deviations / np.abs(found))
    nmse = square / np.sum(target**2)
    assert mru >= least_mru(np.linalg.cond(regressors), nmse, rows, parameters)


def test_the_printed_mru_of_mw_are_not_those_of_the_equations(project):
    printed = pd.read_csv(project / "resources" / "thesis" / "table_3_1.csv")
    assert set(impossible_mru(printed)) == {"MW on multisine", "MW on noise", "MW on chirp"}
    possible = printed.assign(mru_percent=100.0)
    assert impossible_mru(possible) == {}


def test_noise_of_the_twin_has_its_size_its_correlation_and_its_delay():
    time = 0.01 * np.arange(40_000)
    position = np.sin(2 * np.pi * time)
    tissue = SyntheticTissueSettings()
    quiet = replace(tissue, noise_N=0.0)
    force = tissue_test(time, position, quiet, 1, 0)
    np.testing.assert_allclose(force, tissue_force(time, position, 0.405, 3.24, 0.035, 0.0202))
    noise = tissue_test(time, position, replace(tissue, noise_N=0.7, noise_correlation_s=0.05), 1, 0) - force
    assert noise.std() == pytest.approx(0.7, rel=0.05)
    lagged = np.corrcoef(noise[:-5], noise[5:])[0, 1]
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.03)
    late = tissue_test(time, position, replace(quiet, delay_s=0.03), 1, 0)
    np.testing.assert_allclose(late[3:], force[:-3], atol=1e-9)
