"""A verdict hangs on no unit: another clock, other units of motion and force, both turned round, records in another order."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lumbar.interface.reading import read
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.law.law_form import Dimension
from lumbar.tissue.diagnosis.selection.diagnose import diagnose

SIGNIFICANT = 1e-3


def changed(record, clock: float, motion: float, force: float):
    """The same experiment in other units."""
    channels = {
        role: replace(record.channels[role], values=record[role] * factor)
        for role, factor in (("input", motion), ("output", force))
    }
    period = record.period and record.period * clock
    return replace(record, time=record.time * clock, channels=channels, period=period)


def check_alike(records, clock: float, motion: float, force: float):
    """Diagnose the records and the same in other units, the last one first; both say the same."""
    first = diagnose(records)
    second = diagnose([changed(record, clock, motion, force) for record in records[::-1]])
    assert (first.verdict, first.verdict_after) == (second.verdict, second.verdict_after)
    assert first.selected == second.selected
    assert {item.effects for item in first.tied_with} == {item.effects for item in second.tied_with}
    for one, other in zip(first.path, second.path, strict=True):
        assert other.test_rms == pytest.approx(one.test_rms * abs(force), rel=SIGNIFICANT)
        every = [
            estimates(item.fit, verdict.experiment.training, "{x}", "{y}")
            for item, verdict in ((one, first), (other, second))
        ]
        for found, again in zip(*every, strict=True):
            size = Dimension.of(found.unit)
            factor = abs(motion) ** size.x * abs(force) ** size.y * clock**size.s
            # Turned round, an odd effect keeps its sign and an even one takes the other.
            factor *= np.sign(found.value * again.value) or 1
            ends = sorted((found.low * factor, found.high * factor))
            width = ends[1] - ends[0]
            assert again.value == pytest.approx(found.value * factor, abs=0.05 * width), found.name
            assert [again.low, again.high] == pytest.approx(ends, abs=0.1 * width), found.name


def test_the_verdict_is_the_same_in_other_units(shared):
    records = read(shared / "hidden_effects" / "case_03")
    check_alike(records, 1e4, -1e-6, -1e6)


@pytest.mark.statistical
@pytest.mark.parametrize("case", range(36))
def test_every_verdict_is_the_same_in_other_units(shared, case):
    random = np.random.default_rng(case)
    effects = json.loads((shared / "hidden_effects" / "labels.json").read_text())[f"case_{case:02}"][
        "effects"
    ]
    sign = 1 if "contact_loss" in effects else random.choice([-1, 1])  # a contact pushes, it does not pull
    clock, motion, force = 10.0 ** random.uniform([-4, -6, -6], [4, 6, 6])
    check_alike(read(shared / "hidden_effects" / f"case_{case:02}"), clock, sign * motion, sign * force)
