"""Force plates: closed forms for every type, independent readers and physics on real files."""

import ezc3d
import numpy as np
import pytest
from c3d_builder import build_c3d

from lumbar.base.errors import InputError
from lumbar.records.force_plates import read_force_plates
from lumbar.records.ground_forces import UNLOADED_N
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

POINTS = np.random.default_rng(1).normal(0, 500, (50, 2, 3))
PER_FRAME = 4


def push(n=50 * PER_FRAME):
    """Force on the person (N), point (m) and free moment (N·m) on a level floor, axes of the laboratory."""
    phase = np.linspace(0, 6, n)
    force = np.transpose([40 * np.sin(phase), 60 * np.cos(phase), 700 + 80 * np.sin(2 * phase)])
    point = np.transpose([0.4 + 0.1 * np.sin(phase), 0.7 + 0.2 * np.cos(phase), 0 * phase])
    return force, point, 5 * np.sin(3 * phase)


def plate(kind, sign=1.0, moment_unit="Nmm", turn=0.0, depth=-30.0):
    """Corners (mm), signals and parameters of one plate that feels `push`; `sign` -1: force on the plate."""
    force, point, free = push()
    cos, sin = np.cos(turn), np.sin(turn)
    x_axis, y_axis = np.array([cos, sin, 0]), np.array([sin, -cos, 0])
    axes = np.array([x_axis, y_axis, [0, 0, -1]])  # z down
    middle = np.array([400.0, 700, 0])
    half = 300 * x_axis, 450 * y_axis
    corners = [middle + a * half[0] + b * half[1] for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    origin = np.array([3.0, -2.0, depth])
    local = force @ axes.T
    arm = (point - middle / 1e3) @ axes.T
    if kind == 1:
        signals = np.column_stack([local, sign * arm[:, :2] * 1e3, -free * 1e3])
        units = ["N", "N", "N", "mm", "mm", "Nmm"]
    elif kind in (2, 4):
        # Moment about the transducers, from where `origin` leads to the middle of the surface.
        moment = np.cross(arm + origin / 1e3, local) + np.column_stack([0 * free, 0 * free, -free])
        signals = np.column_stack([local, moment * (1e3 if moment_unit == "Nmm" else 1)])
        units = ["N"] * 3 + [moment_unit] * 3
    else:
        a, b = 0.12, 0.2
        moment = np.cross(arm + np.array([0, 0, depth / 1e3]), local) - np.column_stack(
            [0 * free, 0 * free, free]
        )
        # Four posts, of which a rigid plate leaves one combination free: here it is zero.
        z = [
            local[:, 2] / 4 + s * moment[:, 0] / (4 * b) - r * moment[:, 1] / (4 * a)
            for r, s in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
        twist = moment[:, 2] / (4 * b), moment[:, 2] / (4 * a)
        x12, x34 = local[:, 0] / 2 - twist[0], local[:, 0] / 2 + twist[0]
        y14, y23 = local[:, 1] / 2 + twist[1], local[:, 1] / 2 - twist[1]
        signals = np.column_stack([x12, x34, y14, y23, *z])
        units = ["N"] * 8
        origin = np.array([120.0, 200, depth])
    return np.array(corners), sign * signals, origin, units


def write(tmp_path, kind, change=None, points=POINTS, labels=("A", "B"), cut=None, **options):
    corners, signals, origin, units = plate(kind, **options)
    if cut is not None:
        limit = 0.9 * np.abs(signals[:, cut]).max()
        signals[:, cut] = np.clip(signals[:, cut], -limit, limit)
    extra = {
        "ANALOG:LABELS": [f"c{number}" for number in range(signals.shape[1])],
        "ANALOG:UNITS": units,
        "ANALOG:SCALE": [1.0] * signals.shape[1],
        "ANALOG:OFFSET": [0.0] * signals.shape[1],
        "ANALOG:GEN_SCALE": [1.0],
        "FORCE_PLATFORM:USED": [1.0],
        "FORCE_PLATFORM:TYPE": [float(kind)],
        "FORCE_PLATFORM:CORNERS": corners.ravel().tolist(),
        "FORCE_PLATFORM:ORIGIN": origin.tolist(),
        "FORCE_PLATFORM:CHANNEL": [float(number + 1) for number in range(signals.shape[1])],
        "FORCE_PLATFORM:ZERO": [1.0, 0.0],
    }
    if kind == 4:
        matrix = np.diag([2.0, 2, 5, 4, 4, 4]) + 0.1 * np.arange(36).reshape(6, 6) / 36
        signals = signals @ np.linalg.inv(matrix).T
        extra["FORCE_PLATFORM:CAL_MATRIX"] = matrix.T.ravel().tolist()
        extra["ANALOG:UNITS"] = ["V"] * 6
    extra = {name: values for name, values in {**extra, **(change or {})}.items() if values is not None}
    path = tmp_path / "trial.c3d"
    analog = signals.reshape(50, -1)
    path.write_bytes(
        build_c3d(points, labels, analog=analog, analog_per_frame=PER_FRAME, extra=extra, first_frame=11)
    )
    return path


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("turn", [0.0, 0.5, np.pi / 2])
def test_a_known_push_is_found(tmp_path, kind, sign, turn):
    [found] = read_force_plates(write(tmp_path, kind, sign=sign, turn=turn))
    force, point, free = push()
    np.testing.assert_allclose(found.force, force, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(found.centre_of_pressure, point, atol=1e-5)
    np.testing.assert_allclose(found.free_moment, free, atol=2e-3)
    assert found.rate == 400
    np.testing.assert_allclose(found.time, 0.1 + np.arange(200) / 400)
    assert ("the file holds the force on the plate; that on the person was taken" in found.notes) == (
        sign < 0
    )


@pytest.mark.parametrize(("kind", "cut"), [(1, 2), (2, 0), (2, 5), (3, 7), (1, 3), (2, None)])
def test_a_channel_at_the_end_of_its_range_is_named(tmp_path, kind, cut):
    """But not a centre of pressure, which rests where a person stands."""
    [found] = read_force_plates(write(tmp_path, kind, cut=cut))
    named = [f"channel {cut + 1} (c{cut}) is clipped"] if cut not in (None, 3) else []
    assert [note.partition(":")[0] for note in found.notes if "clipped" in note] == named


@pytest.mark.parametrize(("kind", "depth"), [(2, 30.0), (3, 30.0)])
def test_depth_written_with_the_other_sign(tmp_path, kind, depth):
    """Some systems write how deep the transducers lie as a positive number; a plate does not float."""
    path = write(tmp_path, kind, depth=-30.0)
    mirrored = {"FORCE_PLATFORM:ORIGIN": [-3.0, 2.0, depth] if kind == 2 else [120.0, 200.0, depth]}
    (tmp_path / "other").mkdir()
    other = write(tmp_path / "other", kind, mirrored)
    np.testing.assert_array_equal(
        read_force_plates(other)[0].centre_of_pressure, read_force_plates(path)[0].centre_of_pressure
    )


def test_axes_and_units_are_those_of_the_markers(tmp_path):
    """Half a turn of the laboratory about the vertical: right becomes left, forward becomes back."""
    path = write(tmp_path, 2, moment_unit="Nm")
    [there], [here] = read_force_plates(path), read_force_plates(path, MarkerLayout(forward="-y"))
    np.testing.assert_allclose(here.force, there.force * [-1, -1, 1])
    np.testing.assert_allclose(here.centre_of_pressure, there.centre_of_pressure * [-1, -1, 1])
    np.testing.assert_allclose(here.corners.mean(axis=0), [-0.4, -0.7, 0], atol=1e-7)
    np.testing.assert_allclose(there.free_moment, push()[2], atol=2e-3)


def test_unloaded_plate_has_no_centre_of_pressure(tmp_path):
    path = write(tmp_path, 2, {"ANALOG:SCALE": [0.01] * 6})
    [found] = read_force_plates(path)
    assert np.abs(found.force[:, 2]).max() < UNLOADED_N
    assert np.isnan(found.centre_of_pressure).all()
    assert np.isnan(found.free_moment).all()


def test_baseline_of_an_unloaded_plate_is_subtracted(tmp_path):
    """FORCE_PLATFORM:ZERO names frames; a plate on which somebody stands in them keeps its signals."""
    offset = {"ANALOG:OFFSET": [5.0, 0, 3, 0, 0, 0], "FORCE_PLATFORM:ZERO": [1.0, 5.0]}
    [loaded] = read_force_plates(write(tmp_path, 2, offset))
    assert any("no baseline was subtracted" in note for note in loaded.notes)
    [raw] = read_force_plates(
        write(tmp_path, 2, {**offset, "FORCE_PLATFORM:ZERO": None, "ANALOG:SCALE": [0.01] * 6})
    )
    [light] = read_force_plates(write(tmp_path, 2, {**offset, "ANALOG:SCALE": [0.01] * 6}))
    np.testing.assert_allclose(light.force, raw.force - raw.force[:20].mean(axis=0), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"FORCE_PLATFORM:TYPE": [21.0]}, "plate 1 is of type 21; types 1, 2, 3, 4 are read"),
        ({"FORCE_PLATFORM:CORNERS": [1.0] * 5}, "FORCE_PLATFORM:CORNERS holds 5 values; 12 finite numbers"),
        ({"FORCE_PLATFORM:CHANNEL": [1.0, 2.0]}, "names 2 channels; type 2 has 6"),
        ({"FORCE_PLATFORM:CHANNEL": [1.0, 2, 3, 4, 5, 9]}, "no analog channel 9; the file has 6"),
        ({"ANALOG:SCALE": None}, r"analog channel 1 \(c0\) has no ANALOG:SCALE"),
    ],
)
def test_plates_that_cannot_be_read_are_refused(tmp_path, change, said):
    with pytest.raises(InputError, match=said):
        read_force_plates(write(tmp_path, 2, change))


def test_file_without_plates(tmp_path):
    assert read_force_plates(write(tmp_path, 2, {"FORCE_PLATFORM:USED": [0.0]})) == []
    path = tmp_path / "none.c3d"
    path.write_bytes(build_c3d(POINTS, ["A", "B"]))
    assert read_force_plates(path) == []


def test_file_of_a_force_plate_alone(tmp_path):
    """As Kistler's BioWare writes it: no points; plates come out of it, markers do not."""
    path = write(tmp_path, 3, points=np.zeros((50, 0, 3)), labels=[""])
    [found] = read_force_plates(path)
    np.testing.assert_allclose(found.centre_of_pressure, push()[1], atol=1e-5)
    with pytest.raises(InputError, match="no points, only analog channels"):
        read_markers(path)


# Real files


@pytest.mark.parametrize(
    "name", ["lifting/athlete_static_full_spine/c3dfile1", "lifting/qualisys_ior_gait/Qualisys"]
)
def test_same_forces_as_ezc3d(shared, name):
    path = shared / "real" / f"{name}.c3d"
    expected = ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"]
    plates = read_force_plates(path)
    assert len(plates) == len(expected) == 2
    for found, witness in zip(plates, expected, strict=True):
        loaded = np.isfinite(found.centre_of_pressure[:, 0])
        assert loaded.mean() > 0.3
        np.testing.assert_allclose(found.force, witness["force"].T, atol=1e-3)
        centre = witness["center_of_pressure"].T / 1e3
        np.testing.assert_allclose(found.centre_of_pressure[loaded], centre[loaded], atol=1e-6)
        np.testing.assert_allclose(found.free_moment[loaded], witness["Tz"][2, loaded] / 1e3, atol=1e-4)


MOT = """GRF
version=1
nRows=50
nColumns=10
inDegrees=no
endheader
time\t{names}
"""
NAMES = [f"ground_force_{kind}{axis}" for kind in "vp" for axis in "xyz"] + [
    f"ground_torque_{a}" for a in "xyz"
]


def mot(tmp_path, names=NAMES, rows=None, head=MOT, numbers=str):
    force, point, free = (values[::4] for values in push())
    # OpenSim: x forward, y up, z right.
    columns = [force[:, [1, 2, 0]], point[:, [1, 2, 0]], np.transpose([0 * free, free, 0 * free])]
    table = np.column_stack([np.arange(50) / 100, *columns])
    text = head.format(names="\t".join(names)) + "".join(
        "\t".join(f"{value:.8g}" for value in row) + "\n" for row in (table if rows is None else rows(table))
    )
    path = tmp_path / "forces.mot"
    path.write_text(numbers(text))
    return path


OPENSIM = MarkerLayout(up="+y", forward="+x")


@pytest.mark.parametrize(
    "names",
    [
        NAMES,
        [name.replace("ground", "1_ground") for name in NAMES],
        [name.replace("force_", "force_1_").replace("torque_", "torque_1_") for name in NAMES],
    ],
)
def test_opensim_forces(tmp_path, names):
    [found] = read_force_plates(mot(tmp_path, names), OPENSIM)
    force, point, free = (values[::4] for values in push())
    np.testing.assert_allclose(found.force, force, rtol=1e-6)
    np.testing.assert_allclose(found.centre_of_pressure, point, atol=1e-6)
    np.testing.assert_allclose(found.free_moment, free, atol=1e-6)
    assert found.rate == pytest.approx(100)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"head": "time\t{names}\n"}, "no OpenSim motion file"),
        ({"names": [*NAMES[:5], "other", *NAMES[6:]]}, "no column ground_force_pz"),
        ({"names": [*NAMES[:8], "ground_torque_x"]}, "ground_torque_x stands twice"),
        ({"rows": lambda table: table[:, :9]}, "line 8: 9 cells; 10 are needed"),
        ({"rows": lambda table: table[[0, 1, 5, 6]]}, "frame 3 is at 0.05 s; at 50 Hz it would be at 0.04 s"),
        ({"rows": lambda table: np.where(table == table[3, 2], np.inf, table)}, "line 11: inf in column 3"),
        ({"numbers": lambda text: text.replace("0.03\t", "0_0.03\t")}, "line 11: could not convert"),
    ],
)
def test_broken_opensim_forces_are_refused(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        read_force_plates(mot(tmp_path, **options), OPENSIM)


def test_opensim_file_without_forces(tmp_path):
    names = [f"knee_{number}" for number in range(9)]
    assert read_force_plates(mot(tmp_path, names), OPENSIM) == []
