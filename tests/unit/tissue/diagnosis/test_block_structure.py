"""A static curve between linear filters is recognised: which side the filters are on, how the curve bends, how well it does."""

import numpy as np
import pytest
from scipy.signal import lfilter

import lumbar
from lumbar.publishing.figures.law_figure import chain_figure
from lumbar.records.record import Channel, Record
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.law.block_structure import BlockStructure, Curve, Filter, block_structure
from lumbar.tissue.models.motion import Motion

STEP, NOISE = 1e-3, 0.002
FILTERS = {
    "resonance": ([0.02, 0.02], np.poly([0.93 * np.exp(0.25j), 0.93 * np.exp(-0.25j)]).real),
    "low-pass": ([0.0, 0.15], [1.0, -0.85]),
    "none": ([1.0], [1.0]),
}
KINDS = {
    "Wiener": ("resonance", "none"),
    "Hammerstein": ("none", "resonance"),
    "Wiener-Hammerstein": ("resonance", "low-pass"),
}


def one_sided(signal: np.ndarray) -> np.ndarray:
    """As it is below 0, ever flatter above."""
    return np.where(signal < 0, signal, np.tanh(2 * signal) / 2)


def filtered(name: str, signal: np.ndarray) -> np.ndarray:
    numerator, denominator = FILTERS[name]
    gain = np.sum(numerator) / np.sum(denominator)
    return lfilter(np.asarray(numerator) / gain, denominator, signal)


def answer(kind: str, signal: np.ndarray) -> np.ndarray:
    front, back = KINDS[kind]
    return filtered(back, one_sided(filtered(front, signal)))


def excitation(seed: int, samples: int) -> np.ndarray:
    white = np.random.default_rng(seed).standard_normal(samples)
    return lfilter([0.5], [1.0, -0.5], white)


def experiment(kind: str, seed: int, samples: int = 4000) -> Experiment:
    records = []
    for number, name in enumerate(("training", "unseen")):
        signal = excitation(seed + 100 * number, samples)
        force = answer(kind, signal) + NOISE * np.random.default_rng(seed + 7 + number).standard_normal(
            samples
        )
        motion = Motion(STEP * np.arange(samples), signal, STEP)
        records.append(FitData(name, motion, force, settling=100))
    return Experiment(records[0], [records[1]], None, "V", "V", "training")


@pytest.mark.statistical
@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_recognised_with_its_curve(kind):
    found = block_structure(experiment(kind, 1), np.inf)
    assert found.kind == kind
    assert found.test_rms < 1.5 * NOISE < 0.1 * found.linear_rms
    # Where the curve is well visited, up to what moves it along its axes: the zeros of the filters' signals.
    inner = filtered(KINDS[kind][0], excitation(1, 4000))
    seen = np.linspace(*np.quantile(inner, [0.02, 0.98]), 50)
    assert found.curve.apply(seen) == pytest.approx(one_sided(seen), abs=0.03)
    for side, name in zip((found.front, found.back), KINDS[kind], strict=True):
        angle = np.linspace(0.02, 1.0, 50)
        numerator, denominator = (np.asarray(item) for item in FILTERS[name])
        numerator = numerator * denominator.sum() / numerator.sum()
        powers = np.exp(-1j * np.outer(angle, np.arange(4)))
        expected = (powers[:, : len(numerator)] @ numerator) / (powers[:, : len(denominator)] @ denominator)
        assert np.abs(side.response(angle)) == pytest.approx(np.abs(expected), rel=0.05, abs=0.02)


def test_slopes_agree_with_differences():
    curve = Curve(np.linspace(-2, 2, 7), one_sided(np.linspace(-2, 2, 7)))
    front, back = (Filter(*map(np.array, FILTERS[name])) for name in KINDS["Wiener-Hammerstein"])
    chain = BlockStructure(front, curve, back, STEP)
    motion = experiment("Wiener-Hammerstein", 4, 400).training.motion
    slopes, start = chain.slopes(motion), chain.vector
    for place in range(len(start)):
        step = 1e-6 * max(abs(start[place]), 1e-2) * np.eye(len(start))[place]
        difference = chain.with_vector(start + step).simulate(motion) - chain.with_vector(
            start - step
        ).simulate(motion)
        assert slopes[:, place] == pytest.approx(difference / (2 * step[place]), rel=1e-4, abs=1e-6)


def test_linear_dynamics_are_no_chain():
    known = experiment("Wiener", 5)
    linear = known.with_data(
        lambda data: FitData(
            data.name, data.motion, filtered("resonance", data.motion.position), settling=100
        )
    )
    assert block_structure(linear, np.inf) is None


def test_a_curve_goes_on_straight_and_a_filter_rests_where_it_began():
    curve = Curve(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 4.0]))
    outside = curve.apply(np.array([2.0, 3.0, 4.0]))
    assert outside[2] - outside[1] == pytest.approx(outside[1] - outside[0])
    low_pass = Filter(np.array([0.0, 0.3]), np.array([1.0, -0.85]))
    assert low_pass.apply(np.full(50, 3.0)) == pytest.approx(6.0)


@pytest.mark.statistical
def test_a_diagnosis_tells_the_chain_and_draws_it():
    records = [
        Record(
            item.name,
            item.motion.time,
            {
                "input": Channel(item.motion.position, "voltage", "V"),
                "output": Channel(item.force, "voltage", "V"),
            },
        )
        for item in (
            experiment("Wiener-Hammerstein", 1).training,
            experiment("Wiener-Hammerstein", 2).training,
        )
    ]
    records = [Record(name, item.time, item.channels) for name, item in zip("ab", records, strict=True)]
    settings = StudySettings(improvement=ImprovementSettings(forward=True))
    found = lumbar.diagnose(records, train="a", settings=settings)
    assert found.verdict.verdict == "unexplained"
    told = next(item.sentence for item in found.verdict.findings if item.kind == "block_structure")
    assert "A static curve between" in told and "names no mechanism" in told
    content = found.verdict.to_json()["chain"]
    assert content["kind"] == "Wiener-Hammerstein" and content["test_rms"] < 0.1 * content["linear_test_rms"]
    assert len(chain_figure(found.verdict).axes) == 3
