"""Linear dynamics of any order, and detection of exchanged channels and inverted signs."""

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from periodic_records import noise, record
from scipy.signal import butter, cheby1, cheby2, freqs, lfilter, lsim

import lumbar
from column_files import write_columns
from lumbar.records.columns import read_record
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, decimate
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.linear.direction import direction_or_sign
from lumbar.tissue.diagnosis.linear.linear_dynamics import linear_dynamics
from lumbar.tissue.diagnosis.linear.poles import Poles, forces, linear_base, slope_forces
from lumbar.tissue.diagnosis.selection.candidate import evaluate, unseen_improvement
from lumbar.tissue.diagnosis.selection.candidate import fit_base as fit_candidate
from lumbar.tissue.diagnosis.selection.refine import refined_document
from lumbar.tissue.effects.catalogue import catalogues_with
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import read_models
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure

SIGMA = 0.002


def base_of(prepared):
    """Return the base of the linear dynamics of records."""
    model = linear_dynamics(prepared)
    return linear_base(model.poles, model.held)


def motion(seed: int, seconds: float = 60.0, step: float = 0.01, fastest: float = 6.0) -> np.ndarray:
    """Sines of random phases in mm, which begin and end at rest."""
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, step)
    frequency, phase = np.geomspace(0.05, fastest, 40), random.uniform(0, 2 * np.pi, 40)
    window = np.clip(np.minimum(time, seconds - time) / 1.5, 0, 1)
    smooth = window**3 * (10 - 15 * window + 6 * window**2)
    return 0.5 * smooth * np.sin(2 * np.pi * np.outer(time, frequency) + phase).sum(axis=1)


def response(impedance, position: np.ndarray, step: float = 0.01) -> np.ndarray:
    """Force by the impedance (N/mm at s = jω), the motion preceded and followed by rest."""
    size = 8 * len(position)
    s = 2j * np.pi * np.fft.rfftfreq(size, step)
    s[0] = 1e-9j
    return np.fft.irfft(impedance(s) * np.fft.rfft(position, size), size)[: len(position)]


def two_branches(s):
    return 0.5 + 0.02 * s + 0.8 * s / (s + 1 / 0.09) + 0.6 * s / (s + 1 / 1.3)


def springpot(s):
    return 0.3 + 0.5 * s**0.35


def chebyshev(s):
    numerator, denominator = cheby1(3, 0.5, 2 * np.pi * 4.0, analog=True)
    return freqs(numerator, denominator, s.imag)[1]


def resonances(s):
    def mode(frequency, damping):
        omega = 2 * np.pi * frequency
        return omega**2 / (s**2 + 2 * damping * omega * s + omega**2)

    return 1.0 + 0.4 * mode(1.7, 0.03) - 0.2 * mode(3.9, 0.05)


def late(s):
    return (0.5 + 0.9 * s / (s + 1 / 0.15)) * np.exp(-0.023 * s)


def recorded(
    impedance, sigma: float = SIGMA, step: float = 0.01, extra=lambda position: 0.0, clock: float = 1.0
) -> list[lumbar.Record]:
    """Return a training record and two unseen ones with an additional force; a second has the duration `clock`."""
    records = []
    for name, seed, seconds in (("training", 1, 60.0), ("second", 2, 20.0), ("third", 3, 20.0)):
        position = motion(seed, seconds, step)
        force = response(impedance, position, step) + extra(position) + 0.04
        force = force + sigma * noise(len(position), seed + 50)
        records.append(record(position, force, name, step=step * clock))
    return records


def experiment(impedance, *args, **keywords):
    return prepare(recorded(impedance, *args, **keywords))


def base_candidate(prepared, name: str = "KB"):
    return evaluate(fit_base(Structure(BASES[name]), prepared.training), prepared)


@pytest.mark.parametrize("impedance", [two_branches, springpot, chebyshev, resonances, late])
def test_linear_materials_are_recovered_to_the_noise(impedance):
    prepared = experiment(impedance)
    dynamics = linear_dynamics(prepared)
    assert dynamics.train_rms < 1.03 * SIGMA
    assert dynamics.test_rms < 1.15 * SIGMA
    base = base_candidate(prepared)
    assert base.train_rms > 3 * SIGMA
    assert unseen_improvement(base, evaluate(dynamics, prepared), prepared) > 4


@pytest.mark.parametrize("impedance", [two_branches, chebyshev, resonances])
def test_dynamics_of_higher_order_have_the_equation_of_the_material(impedance):
    prepared = experiment(impedance)
    base = base_of(prepared)
    model = fit_candidate(base, prepared)
    assert model.fit.converged
    assert model.train_rms < 1.03 * SIGMA and model.test_rms < 1.15 * SIGMA
    content = refined_document([model], prepared, "")
    (known,) = read_models(content, catalogues_with([], content))
    frequency = np.array([0.3, 1.0, 2.0, 4.0])
    s = 2j * np.pi * frequency
    assert_allclose(known.to_control()(s), impedance(s), rtol=0.03)


def test_delayed_dynamics_have_no_base():
    assert base_of(experiment(late)) is None


@pytest.mark.nightly
@pytest.mark.parametrize("law", [False, True])
def test_best_linear_model_is_reported_saved_and_exported(law, tmp_path):
    settings = lumbar.StudySettings(improvement={"propose_law": law})
    diagnosis = lumbar.diagnose(recorded(resonances), base="KB", train="training", settings=settings)
    assert diagnosis.result.status == "unexplained"
    assert diagnosis.result.linear.fit.structure.base.name == "linear_dynamics"
    diagnosis.save(tmp_path, pictures=False)
    models = lumbar.load_models(tmp_path / "refined.json")
    assert models[0].name == "linear_dynamics" and models[1].name == "KB"
    assert "linear_dynamics" in (tmp_path / "diagnosis.html").read_text()
    assert models[0].scores.test_rms < 1.15 * SIGMA
    written = lumbar.export_fmu(
        tmp_path / "refined.json", tmp_path / "fmu", ["linear_dynamics"], rate_Hz=1000, targets=["host"]
    )
    assert len(written) == 2


def test_delay_of_minutes_is_found_with_a_slow_clock():
    dynamics = linear_dynamics(experiment(late, clock=4096.0))
    assert dynamics.kind == "delayed"
    assert dynamics.poles.delay == pytest.approx(0.023 * 4096, rel=0.02)


def test_dynamics_of_the_true_base_have_its_order():
    prepared = experiment(lambda s: 0.5 + 0.9 * s / (s + 1 / 0.15))
    dynamics, base = linear_dynamics(prepared), base_candidate(prepared)
    assert dynamics.order == 1
    assert dynamics.test_rms < 1.05 * SIGMA
    assert unseen_improvement(evaluate(dynamics, prepared), base, prepared) < 2


@pytest.mark.parametrize(
    "force",
    [lambda z: 0.02 * z**3, lambda z: 0.1 * z**2, lambda z: 0.3 * np.tanh(np.gradient(z, 0.01) / 2.0)],
    ids=["cubic", "quadratic", "friction"],
)
def test_nonlinear_force_is_not_explained_on_unseen_motion(force):
    prepared = experiment(lambda s: 0.5 + 0.9 * s / (s + 1 / 0.15), extra=force)
    dynamics, base = linear_dynamics(prepared), base_candidate(prepared)
    assert dynamics.test_rms > 10 * SIGMA
    assert dynamics.train_rms < 1.001 * base.train_rms


def test_spring_and_slow_pole_do_not_cancel():
    prepared = experiment(lambda s: 0.5 + 0 * s, extra=lambda z: 0.01 * z**3)
    elsewhere = record(motion(9)[300:2300], motion(9)[300:2300], "elsewhere")
    dynamics = linear_dynamics(prepared)
    assert (
        np.abs(dynamics.simulate(Motion.from_record(elsewhere))).max()
        < 10 * np.abs(elsewhere["output"]).max()
    )


def test_single_sine_determines_few_parameters():
    position = 2 * np.sin(2 * np.pi * 0.5 * np.arange(0, 30, 0.01))
    test = motion(4)
    records = [
        record(z, response(lambda s: 0.5 + 0.9 * s / (s + 1 / 0.15), z) + SIGMA * noise(len(z), 5), name)
        for z, name in ((position, "sine"), (test, "test"))
    ]
    dynamics = linear_dynamics(prepare(records, train="sine"))
    assert dynamics.poles.direct == 2
    assert dynamics.order <= 1
    assert dynamics.test_rms < 6 * SIGMA


def test_wiener_hammerstein_system_is_fitted_as_well_as_by_an_fir():
    random = np.random.default_rng(0)
    low = butter(6, 0.4)
    excitation = lfilter(*low, random.standard_normal(20_000))
    before, after = cheby1(3, 0.5, 0.17), cheby2(3, 40, 0.2)
    between = lfilter(*before, excitation)
    output = lfilter(*after, np.where(between > 0.3, 0.3 + 0.25 * (between - 0.3), between))
    prepared = prepare(
        [record(excitation[:14_000], output[:14_000], "a"), record(excitation[14_000:], output[14_000:], "b")]
    )
    delayed = np.stack([np.roll(excitation, lag) for lag in range(80)], axis=1)
    taps = np.column_stack([delayed, np.ones(len(delayed))])[80:14_000]
    solution = np.linalg.lstsq(taps, output[80:14_000])[0]
    best = float(np.std(delayed[14_200:] @ solution[:-1] + solution[-1] - output[14_200:]))
    dynamics = linear_dynamics(prepared)
    assert dynamics.test_rms < 1.05 * best
    assert dynamics.test_rms < 0.5 * base_candidate(prepared, "KV").test_rms


def test_held_command_gives_a_discrete_model():
    """Two levels, changed at random: a third-order discrete response."""
    numerator, denominator = [0.0, 0.1, 0.05], np.poly([0.9, 0.8 + 0.3j, 0.8 - 0.3j])
    records = []
    for name, seed, size in (("training", 1, 3000), ("second", 2, 1500)):
        command = np.repeat(np.sign(np.random.default_rng(seed).standard_normal(size // 5)), 5)
        output = lfilter(numerator, denominator, command - command[0])
        records.append(record(command, output + SIGMA * noise(size, seed), name))
    dynamics = linear_dynamics(prepare(records))
    assert dynamics.order == 3
    assert dynamics.test_rms < 1.1 * SIGMA
    assert dynamics.train_rms < 1.05 * SIGMA


def test_long_records_are_fitted_at_a_lower_rate():
    prepared = experiment(two_branches, step=0.001)
    assert len(decimate(prepared.training).force) < len(prepared.training.force) / 5
    dynamics = linear_dynamics(prepared)
    assert len(dynamics.errors(prepared.training)) == prepared.training.size
    assert dynamics.test_rms < 1.05 * SIGMA
    assert dynamics.train_rms == pytest.approx(SIGMA, rel=0.03)


def test_joint_records_start_from_rest_each():
    parts = [experiment(two_branches), experiment(two_branches, 1.01 * SIGMA)]
    records = [
        record(item.motion.position, item.force, f"{item.name} {suffix}")
        for part, suffix in zip(parts, "ab", strict=True)
        for item in (part.training, *part.tests)
    ]
    joined = prepare(records, train=["training a", "second b"])
    assert linear_dynamics(joined).test_rms < 1.05 * SIGMA


@pytest.mark.parametrize("delay", [0.0, 0.013])
def test_slopes_are_derivatives_of_the_force(delay):
    poles = Poles(np.array([4.0]), np.array([[9.0, 14.0], [1.0, 90.0]]), delay)
    position = motion(1)
    moved = Motion(np.arange(len(position)) * 0.01, position, 0.01)
    linear = np.random.default_rng(0).standard_normal(forces(moved, poles, False).shape[1])
    vector = poles.logarithms

    def force(values):
        return forces(moved, poles.moved_to(values), False) @ linear

    slopes = slope_forces(moved, poles, linear, False)
    for index, unit in enumerate(np.eye(len(vector))):
        expected = (force(vector + 1e-4 * unit) - force(vector - 1e-4 * unit)) / 2e-4
        assert_allclose(slopes[:, index], expected, atol=2e-3 * np.abs(expected).max())


def test_poles_are_reflected_to_stable_ones():
    poles = Poles.from_places(np.array([3.0, -0.5, 2 + 7j, 2 - 7j, -4.0]))
    assert poles.order == 5
    assert (poles.rates > 0).all()
    assert (poles.sections > 0).all()
    assert_allclose(sorted(np.roots([1, *poles.sections[0]]).imag), [-7, 7])
    assert_allclose(np.roots([1, *poles.sections[0]]).real, [-2, -2])


STEP = 0.01
TIME = np.arange(0, 60, STEP)


def finding(*pairs, layout=None):
    """Return the finding in records, each (position, force) or (position, force, step)."""
    records = []
    for position, force, *step in pairs:
        step = step[0] if step else STEP
        records.append(FitData("record", Motion(np.arange(len(position)) * step, position, step), force))
    return direction_or_sign(Experiment(records[0], records[1:], None, "mm", "N", "record"), layout)


def kind(*pairs) -> str | None:
    return getattr(finding(*pairs), "kind", None)


def drive(seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    frequency, phase = random.uniform(0.1, 5.0, 40), random.uniform(0, 2 * np.pi, 40)
    return 0.5 * np.cos(2 * np.pi * np.outer(TIME, frequency) + phase).sum(axis=1)


COMPLIANCES = {
    "kelvin_voigt": ([1.0], [0.08, 0.6]),
    "kelvin_boltzmann": ([0.15, 1.0], [0.15 * 1.5, 0.6]),
    "mass_spring_damper": ([1.0], [0.004, 0.05, 0.6]),
    "mass_damper": ([1.0], [0.05, 0.4, 1e-3]),
}
"""Position over force in s."""


@pytest.mark.parametrize("name", COMPLIANCES)
def test_sign_and_direction_of_materials_driven_by_a_force(name):
    force = drive(1)
    position = lsim(COMPLIANCES[name], force, TIME)[1]
    position = position + 0.002 * np.std(position) * noise(len(TIME), 1)
    assert kind((position, force)) is None
    assert kind((position, -force)) == "sign"
    assert kind((force, position)) == "direction"


def test_inverted_spring_is_distinguished_from_a_mass():
    position = drive(5)
    acceleration = np.gradient(np.gradient(position, STEP), STEP)
    assert kind((position, -0.7 * position)) == "sign"
    assert kind((position, 0.7 * position)) is None
    assert kind((position, 0.01 * acceleration + 0.01 * np.gradient(position, STEP))) is None


def test_mass_moved_from_place_to_place_keeps_its_sign():
    """A carriage on a rack: a force of acceleration and friction, in one direction or there and back."""
    speed = (
        np.interp(TIME, [5, 5.5, 40, 40.5], [0, 1, 1, 0]),
        np.interp(TIME, [1, 2, 3, 4, 5, 6], [0, 8, 0, 0, -8, 0]),
    )
    for moving in speed:
        position, acceleration = np.cumsum(moving) * STEP, np.gradient(moving, STEP)
        force = 16.0 * acceleration + 0.3 * np.sign(moving) + 0.05 * noise(len(TIME), 3)
        pair = position + 1e-4 * noise(len(TIME), 4), force
        assert kind(pair) is None


def test_sign_of_a_tissue_that_breaks_follows_from_the_work_before():
    """The force falls over most of the motion; the work is positive throughout."""
    position = -0.1 * TIME
    force = -1.5 * (1 - np.exp(position)) * np.exp(-(np.clip(-1.5 - position, 0, None) ** 2)) + 0.03 * noise(
        len(TIME), 5
    )
    assert np.corrcoef(position, force)[0, 1] < 0
    assert kind((position, force)) is None
    assert kind((position, -force)) == "sign"


@pytest.mark.parametrize("drift", [-1e-3, 0.0, 1e-3])
def test_hold_has_no_sign(drift):
    """The force relaxes by 2 N while the frame yields by some micrometres."""
    relaxed = 2 * np.exp(-TIME / 10)
    position = drift * relaxed + 1e-4 * noise(len(TIME), 6)
    for force in (3 + relaxed, -3 - relaxed, 3 + 0 * relaxed):
        assert kind((position, force + 0.02 * noise(len(TIME), 7))) is None


def test_ramp_to_a_hold_shows_its_sign():
    position = np.clip(TIME / 2, 0, 1)
    force = position * (1 + np.exp(-TIME / 5)) + 0.01 * noise(len(TIME), 8)
    assert kind((position, force)) is None
    assert kind((position, -force)) == "sign"


def test_delayed_force_is_not_an_inverted_sign():
    """A spring with a delay of 20 ms seems to give off energy."""
    position = drive(6)
    assert kind((position[2:], 0.7 * position[:-2])) is None


def test_command_of_two_levels_is_not_a_position():
    command = np.repeat(np.sign(np.random.default_rng(0).standard_normal(len(TIME) // 20)), 20)
    speed = np.abs(lsim(([1.0], [0.02, 0.2, 1.0]), command, TIME)[1])
    result = finding((command, speed))
    assert result.kind == "direction" and result.value > 0.9
    assert kind((command, 0.8 * command)) is None  # the force of a stiff tissue jumps with its position


def test_relaxing_tissue_absorbs_energy_of_steps_in_two_samples():
    position = np.repeat(np.sign(np.random.default_rng(0).standard_normal(len(TIME) // 20)), 20)
    position = np.convolve(position, [0.6, 0.4], "same")
    decay = np.exp(-STEP / 0.1)
    force = 0.3 * position + lfilter([1.0], [1.0, -decay], np.diff(position, prepend=position[0]))
    assert kind((position, force + 0.01 * noise(len(TIME), 9))) is None


RIGHT = ColumnLayout(
    columns={
        "time": ColumnSettings(column="t [s]", unit="s", quantity="time"),
        "input": ColumnSettings(column=3, unit="mm", quantity="position", offset=-2.0),
        "output": ColumnSettings(column="u: force", unit="N", quantity="force", scale=0.5),
    }
)


def change_columns(layout, **columns):
    return layout.model_copy(update={"columns": {**layout.columns, **columns}})


@pytest.mark.parametrize(
    "wrong",
    [
        change_columns(RIGHT, input=RIGHT.columns["output"], output=RIGHT.columns["input"]),
        change_columns(RIGHT, output=RIGHT.columns["output"].model_copy(update={"scale": -0.5})),
    ],
    ids=["direction", "sign"],
)
def test_suggested_yaml_corrects_records(tmp_path, wrong):
    force = drive(7)
    position = lsim(COMPLIANCES["kelvin_voigt"], force, TIME)[1]
    file = tmp_path / "record.csv"
    write_columns(file, **{"t [s]": TIME, "u: force": 2 * force, "z": position + 2})
    record = read_record(file, wrong)
    sentence = finding((record["input"], record["output"]), layout=wrong).sentence
    lines = yaml.safe_load(sentence[sentence.index("\ntissue:") :])["tissue"]["layout"]["columns"]
    columns = {role: ColumnSettings(**column) for role, column in lines.items()}
    corrected = read_record(file, change_columns(wrong, **columns))
    assert_allclose(corrected["input"], position, atol=1e-12)
    assert_allclose(corrected["output"], force, atol=1e-12)


def test_valid_experiments_have_no_sign_or_direction_finding(shared):
    folders = [*(shared / "hidden_effects").glob("case_*"), *(shared / "hard_effects").glob("*/records")]
    for folder in sorted([*folders, *(shared / "protocols").glob("p[01]?/records")])[::3]:
        pairs = []
        for file in sorted(folder.glob("*.csv")):
            time, position, force = np.loadtxt(file, delimiter=",", skiprows=1).T
            pairs.append((position, force, float(time[1] - time[0])))
        assert kind(*pairs) is None, folder
