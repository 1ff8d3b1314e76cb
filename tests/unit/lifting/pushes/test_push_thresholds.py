"""Thresholds of stepping against a quadrature written out, the push chosen next, and sheets that cannot be read."""

import numpy as np
import pandas as pd
import pytest

import lumbar
from lumbar.base.errors import InputError
from lumbar.lifting.pushes.dose_response import posterior_of
from lumbar.lifting.pushes.push_design import expected_variance
from lumbar.lifting.pushes.push_sheet import records_of


def pushed(persons: int, pushes: int, seed: int = 0, drift: float = 0.0) -> pd.DataFrame:
    """Pushes forward from 2 to 30 N·s of persons whose thresholds lie about 9 N·s, and a measure that tells them."""
    rng = np.random.default_rng(seed)
    person, session = np.repeat(np.arange(persons), pushes), np.tile(np.linspace(-0.5, 0.5, pushes), persons)
    own = np.log(9) + 0.4 * rng.standard_normal(persons)[person]
    size = rng.uniform(2, 30, person.size)
    odds = (np.log(size) - own - drift * session) / 0.12
    stepped = rng.random(person.size) < 1 / (1 + np.exp(-np.clip(odds, -500, 500)))
    columns = {
        "person": [f"p{item}" for item in person],
        "direction": "forward",
        "impulse_N_s": size,
        "stepped": stepped,
    }
    return pd.DataFrame({**columns, "margin": own, "noise": rng.standard_normal(person.size)})


def quadrature(sheet: pd.DataFrame, sought: str) -> np.ndarray:
    """Quantiles of a person's ln threshold by sums over grids of all persons', their mean and scatter, and the curve's width."""
    low, high = np.log(sheet["impulse_N_s"]).agg(["min", "max"])
    t, unit = np.linspace(low - 3, high + 3, 801), np.linspace(-4, 4, 41)
    fine = np.linspace(-4, 4, 161)
    mean = (low + high) / 2 + max(1, (high - low) / 2) * fine[:, None, None]
    scatter, weight = 0.25 * np.exp(0.7 * unit[:, None]), np.exp(-(unit**2) / 2)
    among = np.exp(-(((t - mean) / scatter) ** 2) / 2) / scatter
    own = {}
    for person, rows in sheet.groupby("person"):
        odds = (np.log(rows["impulse_N_s"].to_numpy())[:, None] - t) / (0.12 * np.exp(unit[:, None, None]))
        p = 0.01 + 0.98 / (1 + np.exp(-np.clip(odds, -500, 500)))
        own[person] = np.where(rows["stepped"].to_numpy(bool)[:, None], p, 1 - p).prod(axis=1)
    joint = np.exp(-(fine[:, None, None] ** 2) / 2) * weight[:, None] * weight
    for person in own.keys() - {sought}:
        joint = joint * (among @ own[person].T)
    inside = joint.reshape(-1, len(unit)).T @ among.reshape(-1, len(t))
    density = (inside * own[sought]).sum(axis=0)
    return np.interp([0.025, 0.5, 0.975], np.cumsum(density) / density.sum(), t)


@pytest.mark.parametrize(("persons", "stepped"), [(3, None), (3, False), (1, None), (1, True)])
def test_thresholds_are_those_of_a_quadrature(persons, stepped):
    sheet = pushed(persons, 10, 4)
    if stepped is not None:  # the first one never, or always
        sheet.loc[sheet["person"] == "p0", "stepped"] = stepped
    draws = [posterior_of(records_of(sheet), seed).log_threshold[:, 0, 0] for seed in range(6)]
    expected = quadrature(sheet, "p0")
    found = np.quantile(np.concatenate(draws), [0.025, 0.5, 0.975])
    assert found == pytest.approx(expected, abs=0.06 * np.ptp(expected))


def test_persons_lend_each_other_what_they_have_in_common():
    sheet = pushed(12, 16)
    found = lumbar.push_thresholds(sheet)
    everybody = found.table.frame.set_index("person")
    frame, nobody = everybody.iloc[:-1], everybody.iloc[-1]
    true = np.exp(sheet.groupby("person", sort=False)["margin"].first())
    assert ((frame["low"] < true) & (true < frame["high"])).sum() >= 10
    alone = lumbar.push_thresholds(sheet[sheet["person"] == "p0"]).table.frame.iloc[0]
    assert np.log(frame["high"] / frame["low"])["p0"] < np.log(alone["high"] / alone["low"])
    assert nobody["low"] < frame["low"].median() and nobody["high"] > frame["high"].median()
    again = lumbar.push_thresholds(sheet).table.frame
    pd.testing.assert_frame_equal(again, found.table.frame, check_exact=True)
    rows = found.tables["push_increments"].frame.set_index("measure")
    assert rows.loc["margin", "increment"] > 0.02 > 10 * abs(rows.loc["noise", "increment"])
    calibration = found.tables["push_calibration"].frame
    assert calibration["pushes"].sum() == len(sheet)
    assert (
        (calibration["low"] < calibration["mean_predicted"])
        & (calibration["mean_predicted"] < calibration["high"])
    ).all()


def test_a_person_who_learns_is_told():
    assert "steps become rarer" in str(lumbar.push_thresholds(pushed(6, 40, drift=1.5)))
    assert "steps become" not in str(lumbar.push_thresholds(pushed(6, 40)))


def test_the_next_push_leaves_the_least_variance_and_is_safe():
    rng = np.random.default_rng(1)
    t, chances = rng.standard_normal((500, 2)), rng.random((3, 500))
    for found, p in zip(expected_variance(chances, t), chances, strict=True):
        both = [np.diag(np.cov(t.T, aweights=weight, bias=True)) * weight.mean() for weight in (p, 1 - p)]
        assert found == pytest.approx(sum(both), rel=1e-9)
    sizes = {"forward": (2.0, 30.0)}
    first = lumbar.push_thresholds(pushed(1, 1).head(0), sizes=sizes).next_push("ann")
    assert first.impulse_N_s == 2.0
    stood = pd.DataFrame([{"person": "ann", "direction": "forward", "impulse_N_s": 4.0, "stepped": "no"}])
    found = lumbar.push_thresholds(stood, sizes=sizes)
    assert 4 < found.next_push("ann").impulse_N_s <= 6
    assert found.next_push("ann", step=1.1).impulse_N_s <= 4.4
    known = lumbar.push_thresholds(pushed(1, 40)).next_push("p0")
    assert known.sd_after < known.sd_now and 0.2 < known.chance < 0.8
    with pytest.raises(InputError, match="step is 1; allowed: above 1"):
        found.next_push("ann", step=1)


def test_every_wrong_cell_of_a_sheet_is_told_at_once(tmp_path):
    sheet = pushed(1, 4).astype({"impulse_N_s": object, "stepped": object})
    sheet.loc[0, "impulse_N_s"], sheet.loc[1, "impulse_N_s"], sheet.loc[2, "stepped"] = "12,5", 0, "perhaps"
    with pytest.raises(
        InputError, match=r"3 problems(.|\n)*row 2, column impulse_N_s: 12,5(.|\n)*row 4, column stepped"
    ):
        lumbar.push_thresholds(sheet.assign(phase=0.5))
    with pytest.raises(InputError, match=r"sizes: none of direction 'forward'(.|\n)*back from 5 to 2"):
        lumbar.push_thresholds(pushed(1, 4), sizes={"back": (5, 2)})
    with pytest.raises(InputError, match="no push yet"):
        lumbar.push_thresholds(pushed(1, 4).head(0))
    (tmp_path / "pushes.csv").write_text("person,direction,impulse_N_s,stepped\nann,forward,12,5,1\n")
    with pytest.raises(InputError, match="more cells than the header"):
        lumbar.push_thresholds(tmp_path / "pushes.csv")
