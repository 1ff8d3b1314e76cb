"""Numbers on the page of the thesis's items, recomputed from the print, in closed form or by another library."""

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import dft
from scipy.stats import linregress

from lumbar.lifting.stability.funnel.exact_funnel import Funnels
from lumbar.lifting.stability.table_4_1 import published_note
from lumbar.settings.lifting import StabilitySettings
from lumbar.tissue.identification.arx_search import RidgePath
from refusing import has_tokens


@pytest.fixture(scope="module")
def printed(project):
    """Tables 3.1 and 4.1 of the thesis."""
    folder = project / "resources" / "thesis"
    return [pd.read_csv(folder / f"table_{number}.csv") for number in ("3_1", "4_1")]


def test_chapter_2_matrix_of_the_fourier_transform_is_unitary_after_division():
    matrix = dft(12)
    values = np.random.default_rng(0).normal(size=12)
    np.testing.assert_allclose(matrix @ values, np.fft.fft(values), atol=1e-12)
    np.testing.assert_allclose(matrix @ matrix.conj().T, 12 * np.eye(12), atol=1e-12)


def test_chapter_2_least_squares_of_one_regressor_is_the_slope_through_the_mean():
    inputs, noise = np.random.default_rng(1).normal(size=(2, 80))
    outputs = 0.7 * inputs + 0.1 * noise
    demeaned = [column - column.mean() for column in (inputs, outputs)]
    solution = RidgePath.factorise(demeaned[0][:, None], demeaned[1], 80).solution(0.0)
    assert solution == pytest.approx([linregress(inputs, outputs).slope], rel=1e-12)


def test_chapter_3_printed_fit_follows_from_printed_vaf(printed):
    table, _ = printed
    low, high = (100 * (1 - np.sqrt(1 - (table.vaf_percent + shift) / 100)) for shift in (-0.005, 0.005))
    assert (table.fit_percent.between(low - 0.005, high + 0.005)).all()


def test_chapter_3_condition_number_of_two_standardised_columns_is_that_of_their_correlation():
    first, second = np.random.default_rng(2).normal(size=(2, 500))
    columns = np.column_stack([first - first.mean(), 30 * (0.6 * first + second)])
    columns[:, 1] -= columns[:, 1].mean()
    size = abs(np.corrcoef(columns.T)[0, 1])
    path = RidgePath.factorise(columns, first, len(first))
    assert path.condition_number == pytest.approx(np.sqrt((1 + size) / (1 - size)), rel=1e-9)


def test_chapter_4_goal_set_of_the_default_weights():
    """Semi-axes and area of 100 θ² + 10 θ̇² ≤ 1."""
    weight = np.array(StabilitySettings().regulator.terminal_weight)
    funnels = Funnels(
        "exact", np.ones(1), np.tile([weight[0, 0], weight[0, 1], weight[1, 1]], (3, 1, 1)), np.ones((3, 1))
    )
    assert funnels.reach[0] == pytest.approx([0.1, np.sqrt(0.1)])
    assert funnels.mean_area == pytest.approx([np.pi * 0.1 * np.sqrt(0.1)])


def test_chapter_4_columns_of_the_printed_table_oppose_one_another(printed):
    _, table = printed
    line = linregress(table.lateral_bending_percent, table.flexion_extension_percent)

    assert has_tokens(published_note(table), f"{line.rvalue:+.2f}…6 of 9")


def test_chapter_5_gain_of_ho_in_print(printed):
    table, _ = printed
    vaf = table.pivot(index="trained_on", columns="model", values="vaf_percent")
    gain = vaf.HO - vaf.KB
    assert gain["multisine"] == pytest.approx(1.48)
    assert (100 * gain / (100 - vaf.KB)).round().tolist() == [8, 8, 4]  # chirp, multisine, noise


def test_chapter_5_printed_metrics_that_contradict_the_discussion(printed):
    """NMSE in training and mean residuals are smallest on noise, and HO's NMSE ties with KB's in two cells."""
    table, _ = printed
    for column in ("nmse_train", "mean_residual_N"):
        wide = table.pivot(index="trained_on", columns="model", values=column)
        assert set(wide.idxmin()) == {"noise"}
    cells = (
        table.set_index(["trained_on", "model"])[["nmse_train", "nmse_test_1", "nmse_test_2"]]
        .stack()
        .unstack("model")
    )
    assert cells.index[cells.HO >= cells.KB].tolist() == [("chirp", "nmse_test_1"), ("noise", "nmse_train")]
