"""C3D: real awkward and broken files, and files built byte by byte from the C3D user guide."""

import gzip
import struct

import ezc3d
import numpy as np
import pytest
from c3d_builder import DEC, INTEL, MIPS, build_c3d
from lifting_cases import missing_share

import lumbar
from refusing import has_tokens, refusal

pytestmark = pytest.mark.usefixtures("read_in_this_process")

LABELS = ["C7", "SACR", "LTOE"]


@pytest.fixture
def points():
    generator = np.random.default_rng(5)
    return (
        np.cumsum(generator.normal(0, 3, (40, 3, 3)), axis=0)
        + np.array([300, -200, 900])
        + 150 * np.arange(3)[:, None]
    )


def write(tmp_path, content, name="trial.c3d"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


def read_c3d(path):
    """Read the markers in the file's axes, in metres."""
    return lumbar.read(path, "markers", layout=lumbar.MarkerLayout(check_axes=False, subject_prefix="keep"))


def stacked(file):
    """Return positions in millimetres, shape (n_frames, n_points, 3)."""
    return 1e3 * np.stack(list(file.positions.values()), axis=1)


def test_subject_prefix_is_stripped_and_gaps_are_reported(shared):
    path = shared / "real" / "c3d_edge" / "07_subject_labels.c3d"
    recording = lumbar.read(path, "markers", layout=lumbar.MarkerLayout())
    assert {"C7", "SACR", "LASI"} <= set(recording.positions)
    assert not any(":" in label for label in [*recording.positions, *recording.dropped])
    # 52 % of all samples are invalid: points never seen are left out, the rest has gaps.
    everything = ezc3d.c3d(str(path))["data"]["meta_points"]["residuals"][0] < 0
    assert everything.mean() == pytest.approx(0.52, abs=0.005)
    never = sum(reason == "never seen" for reason in recording.dropped.values())
    assert never == 34
    assert missing_share(recording) > 0.2


def test_model_outputs_are_not_markers(shared):
    recording = read_c3d(shared / "real" / "c3d_edge" / "10_plugin_outputs.c3d")
    expected = {"RKNE", "RTOE", "RTIB", "RASI", "RTHI", "RHEE", "LKNE", "RANK", "RCLA"}
    expected |= {"LTHI", "LASI", "C7", "LTOE", "LANK", "SACR", "LHEE", "LCLA", "LTIB"}
    assert set(recording.positions) == expected
    kinds = {
        "LHipAngles": "angle",
        "LGroundReactionForce": "force",
        "RKneeMoment": "moment",
        "LAnklePower": "power",
    }
    for label, kind in kinds.items():
        assert has_tokens(recording.dropped[label], kind), label


@pytest.mark.parametrize(
    "name",
    [
        "c3d_edge/01_intel_int",
        "c3d_edge/02_intel_float",
        "c3d_edge/03_dec_int",
        "c3d_edge/04_dec_float",
        "c3d_edge/07_subject_labels",
        "lifting/athlete_floor_pickup_squats/squat",
        "lifting/athlete_static_full_spine/c3dfile1",
        "lifting/ktk_pig_com_oracle/gait",
        "lifting/qualisys_ior_gait/Qualisys",
        "lifting/s2m_box_transfer/Vicon",
    ],
)
def test_same_coordinates_as_ezc3d(shared, name):
    path = shared / "real" / f"{name}.c3d"
    content = ezc3d.c3d(str(path))
    labels = content["parameters"]["POINT"]["LABELS"]["value"]
    metres = {"mm": 1e-3, "m": 1.0}[content["parameters"]["POINT"]["UNITS"]["value"][0]]
    reference = content["data"]["points"][:3] * metres
    file = read_c3d(path)
    for label, values in file.positions.items():
        expected = reference[:, labels.index(label)].T
        largest = np.nanmax(np.abs(expected))
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-6 * largest, equal_nan=True)
    assert file.rate == content["parameters"]["POINT"]["RATE"]["value"][0]


@pytest.mark.parametrize(
    ("name", "tokens"),
    [
        ("12_bad_parameter_section", "LABELS … end … byte"),
        ("13_phasespace", "POINT:USED, "),
        ("15_zero_bytes", "0 bytes"),
        ("18_bad_parameter_offset", "LABELS … byte 745 … byte 1169"),
        ("91_derived_truncated_params", "700 bytes"),
    ],
)
def test_broken_files_are_rejected(shared, name, tokens):
    path = shared / "real" / "c3d_edge" / f"{name}.c3d"
    assert has_tokens(refusal(read_c3d, path), f"{path.name} … {tokens}")


# Built files


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("scale", [-1.0, 0.05])
@pytest.mark.parametrize("channels", [0, 3])
def test_built_file_is_read_back(tmp_path, points, processor, scale, channels):
    residuals = np.zeros(points.shape[:2])
    residuals[4:7, 1] = -1
    analog = np.random.default_rng(1).integers(-900, 900, (40, 5 * channels)) if channels else None
    content = build_c3d(
        points,
        LABELS,
        processor=processor,
        scale=scale,
        residuals=residuals,
        analog=analog,
        analog_per_frame=5 if channels else 1,
    )
    file = read_c3d(write(tmp_path, content))
    expected = points.copy()
    expected[4:7, 1] = np.nan
    np.testing.assert_allclose(stacked(file), expected, atol=1e-4 if scale < 0 else 0.026, rtol=0)
    assert (file.rate, list(file.positions)) == (100, LABELS)


def test_frame_count_beyond_header_field_is_read(tmp_path):
    n_frames = 65700
    points = np.ones((n_frames, 1, 3), np.float32)
    points[:, 0, 0] = np.arange(n_frames)
    file = read_c3d(write(tmp_path, build_c3d(points, ["C7"], trial=True, long_frames=True)))
    np.testing.assert_allclose(1e3 * file["C7"], points[:, 0])


def test_frame_numbers_beyond_header_field_are_read(tmp_path, points):
    file = read_c3d(write(tmp_path, build_c3d(points, LABELS, first_frame=65510, trial=True)))
    np.testing.assert_allclose(stacked(file), points, rtol=1e-6)
    np.testing.assert_allclose(file.time, (65509 + np.arange(40)) / 100)
    # A reader that stops at frame 65535 would return 26.
    file = read_c3d(write(tmp_path, build_c3d(points, LABELS, first_frame=65510, long_frames=True)))
    np.testing.assert_allclose(stacked(file), points, rtol=1e-6)


@pytest.mark.parametrize(
    ("scale", "tokens"), [(-1.0, "scale factor 1 … 32-bit"), (0.1, "scale factor -0.1 … 16-bit")]
)
def test_scale_factor_with_the_wrong_sign_is_rejected(tmp_path, points, scale, tokens):
    content = build_c3d(points, LABELS, scale=scale)
    wrong = content.replace(struct.pack("<f", scale), struct.pack("<f", -scale), 2)
    assert has_tokens(refusal(read_c3d, write(tmp_path, wrong)), tokens)


@pytest.mark.parametrize(("unit", "factor", "scale"), [("m", 1, "0.001"), ("mm", 1e-3, "1000")])
def test_unit_that_is_not_that_of_the_numbers_names_the_scale(tmp_path, points, unit, factor, scale):
    content = build_c3d(factor * points, LABELS, unit=unit)
    assert has_tokens(refusal(read_c3d, write(tmp_path, content)), f"'{unit}' … markers.scale … {scale}")
    layout = lumbar.MarkerLayout(check_axes=False, scale=float(scale))
    read = lumbar.read(tmp_path / "trial.c3d", "markers", layout=layout)
    np.testing.assert_allclose(stacked(read), points, rtol=1e-5)


def test_frame_count_beyond_all_fields_is_rejected(tmp_path):
    content = build_c3d(np.ones((65600, 1, 3), np.float32), ["C7"])
    assert has_tokens(refusal(read_c3d, write(tmp_path, content)), "65535 frames")


def test_zero_and_infinite_samples_are_missing(tmp_path, points):
    points[3, 0] = 0
    points[5, 1] = np.inf
    file = read_c3d(write(tmp_path, build_c3d(points, LABELS)))
    assert np.flatnonzero(np.isnan(file.positions["C7"]).all(axis=1)).tolist() == [3]
    assert np.flatnonzero(np.isnan(file.positions["SACR"]).all(axis=1)).tolist() == [5]


def test_points_listed_as_angles_are_dropped(tmp_path, points):
    # Groups come in pairs, the list's name and the name of one entry; only the first names a list.
    extra = {"POINT:TYPE_GROUPS": ["TILTS", "TILT"], "POINT:TILTS": ["LTOE"], "POINT:TILT": ["C7"]}
    extra["POINT:ANGLES"] = ["SACR"]
    file = read_c3d(write(tmp_path, build_c3d(points, LABELS, extra=extra)))
    assert list(file.positions) == ["C7"]
    assert set(file.dropped) == {"SACR", "LTOE"}
    assert has_tokens(file.dropped["SACR"], "angle") and has_tokens(file.dropped["LTOE"], "POINT:TILTS")


@pytest.mark.parametrize("packed", [False, True])
def test_child_process_returns_content_of_file(tmp_path, points, packed):
    points[3, 1] = 0
    event = {"USED": [1.0], "TIMES": [0.0, 0.1], "LABELS": ["Foot Off"], "CONTEXTS": ["Left"]}
    extra = {f"EVENT:{name}": values for name, values in event.items()} | {"POINT:ANGLES": ["SACR"]}
    content = build_c3d(points, LABELS, extra=extra)
    path = write(tmp_path, gzip.compress(content), "trial.c3d.gz") if packed else write(tmp_path, content)
    recording = read_c3d(path)
    assert [event.full_label for event in recording.events] == ["Left Foot Off"]
    assert (recording.rate, recording.source, *recording.dropped) == (100, str(path), "SACR")
    np.testing.assert_allclose(1e3 * recording["C7"], points[:, 0], rtol=1e-6)


def test_points_without_unique_label_are_dropped(tmp_path):
    points = np.random.default_rng(3).normal(0, 500, (6, 5, 3))
    file = read_c3d(write(tmp_path, build_c3d(points, ["C7", "A", "A", "*17"])))
    assert list(file.positions) == ["C7"]
    assert set(file.dropped) == {"A", "*17", "point 5"}
    assert has_tokens(file.dropped["A"], "2 points") and file.dropped["*17"] == file.dropped["point 5"]


def test_file_without_any_name_is_rejected_with_a_remedy(tmp_path, points):
    message = refusal(read_c3d, write(tmp_path, build_c3d(points, ["*0", "*1", "*2"])))
    assert has_tokens(message, "*0, *1, *2 … unlabelled … label … export")


def test_rotation_matrices_after_the_points_are_noted(tmp_path, points):
    """Two matrices of 4 × 4 elements and a reliability per frame, from the block after the points, as ezc3d writes them."""
    extra = {"ROTATION:USED": [2.0], "ROTATION:RATIO": [1.0], "ROTATION:DATA_START": [99.0]}
    blocks = len(build_c3d(points, LABELS, extra=extra)) // 512 + 1
    content = build_c3d(points, LABELS, extra=extra | {"ROTATION:DATA_START": [blocks + 1.0]})
    content = content.ljust(512 * blocks, b"\0") + np.ones(40 * 2 * 17, "<f4").tobytes()
    file = read_c3d(write(tmp_path, content))
    np.testing.assert_allclose(stacked(file), points, rtol=1e-6)
    assert has_tokens(" ".join(file.notes), "rotation matrices")
    assert has_tokens(refusal(read_c3d, write(tmp_path, content[:-700])), "bytes were inserted")


@pytest.mark.parametrize(
    ("change", "tokens"),
    [
        ({"replace": {"POINT:RATE": [50.0]}}, "100 … header … 50 … POINT:RATE"),
        ({"rate": 0.0}, "0 … positive"),
        ({"rate": np.nan}, "POINT:RATE: [nan]"),
        ({"extra": {"POINT:FRAMES": ["many"]}}, "POINT:FRAMES: ['many']"),
        ({"extra": {"POINT:LABELS": [1.0, 2.0]}}, "POINT:LABELS: [1.0, 2.0]"),
    ],
)
def test_contradictions_are_rejected(tmp_path, points, change, tokens):
    message = refusal(read_c3d, write(tmp_path, build_c3d(points, LABELS, **change)))
    assert has_tokens(message, tokens)


@pytest.mark.parametrize("missing_bytes", [1, 48, 1900])
def test_truncated_file_is_rejected(tmp_path, points, missing_bytes):
    content = build_c3d(points, LABELS)
    message = refusal(read_c3d, write(tmp_path, content[:-missing_bytes]))
    assert has_tokens(message, "40 frames … 48 bytes")


@pytest.mark.parametrize("inserted", [bytes(range(4)), bytes(512)])
def test_bytes_after_last_frame_are_noted(tmp_path, points, inserted):
    """A word that was pushed out is 0, as what fills a block, and an inserted block leaves it full."""
    content = build_c3d(points, LABELS)
    content = content[:-900] + inserted + content[-900:] + bytes(-len(content) % 512)
    assert has_tokens(" ".join(read_c3d(write(tmp_path, content)).notes), "bytes … inserted")


@pytest.mark.parametrize(
    ("extra", "renamed", "groups", "notes"),
    [
        # Group numbers with a hole are legal, and fatal to readers that keep groups in an array by number.
        ({"SUBJECTS:MASS": [70.0]}, b"MASS", {b"SUBJECTS": -90, b"MASS": 90}, ()),
        (
            {"SUBJECTS:BODYMASS": [70.0]},
            b"BODYMASS",
            {b"BODYMASS": 77},
            ("BODYMASS … group",),
        ),
        (
            {"SUBJECTS:BODYMASS": [70.0], "SUBJECTS:BODYM2SS": [71.0]},
            b"BODYM2SS",
            {},
            ("SUBJECTS:BODYMASS … duplicate",),
        ),
    ],
)
def test_irregular_groups_are_read(tmp_path, points, extra, renamed, groups, notes):
    content = bytearray(build_c3d(points, LABELS, extra=extra))
    for name, group in groups.items():  # the number of a parameter's group; negative of a group
        place = content.index(name) - 1
        content[place : place + 1] = struct.pack("b", group)
    file = read_c3d(write(tmp_path, bytes(content).replace(renamed, renamed.replace(b"2", b"A"))))
    np.testing.assert_allclose(stacked(file), points, rtol=1e-6)
    assert len(file.notes) == len(notes)
    assert all(has_tokens(note, tokens) for note, tokens in zip(file.notes, notes, strict=True))


@pytest.mark.parametrize(
    ("change", "tokens"),
    [
        ({"replace": {"POINT:FRAMES": [39]}}, "40 … header … 39 … POINT:FRAMES … 39"),
        ({"extra": {"POINT:LONG_FRAMES": [41.0]}}, "41 … POINT:LONG_FRAMES … 40"),
        # Where the file ends tells which of two statements is right.
        ({"extra": {"POINT:LONG_FRAMES": [50.0]}}, "50 … POINT:LONG_FRAMES … 40"),
        ({"replace": {"POINT:DATA_START": [1]}}, "POINT:DATA_START … 1 … 3 … header … 3"),
        ({"replace": {"POINT:USED": [9]}}, "POINT:USED … 9 … 3 … header … 3"),
        ({"omit": ["POINT:SCALE"]}, "POINT:SCALE … header … -1"),
        ({"omit": ["POINT:RATE"]}, "POINT:RATE … header … 100"),
        # 200.7 Hz over 100 Hz are two samples per frame, as the header has them.
        ({"replace": {"ANALOG:RATE": [200.7]}}, "20.07 … ANALOG:USED … ANALOG:RATE … header"),
    ],
)
def test_harmless_contradictions_are_read_and_noted(tmp_path, points, change, tokens):
    analog = np.zeros((40, 20))
    file = read_c3d(write(tmp_path, build_c3d(points, LABELS, analog=analog, analog_per_frame=2, **change)))
    np.testing.assert_allclose(stacked(file), points[: len(file.time)], rtol=1e-6)
    assert len(file.time) in (39, 40)
    assert file.rate == 100
    assert any(has_tokens(note, tokens) for note in file.notes), file.notes


@pytest.mark.parametrize(
    ("processor", "place", "new", "tokens"),
    [
        (INTEL, 2, b"\x09", "POINT:USED … 3 … 9 … header … 3"),
        (INTEL, 16, b"\x05", "POINT:DATA_START … 3 … 5 … header … 3"),
        (INTEL, 16, b"\x90", "POINT:DATA_START … 3 … 144 … header … 3"),
        (MIPS, 515, bytes([INTEL]), "84 … 86 (MIPS)"),
        (INTEL, 515, bytes([DEC]), "85 … 84 (Intel)"),
    ],
)
def test_header_is_corrected_by_file_size(tmp_path, points, processor, place, new, tokens):
    content = build_c3d(points, LABELS, processor=processor)
    file = read_c3d(write(tmp_path, content[:place] + new + content[place + 1 :]))
    np.testing.assert_allclose(stacked(file), points, rtol=1e-6)
    assert has_tokens(" ".join(file.notes), tokens)


def test_scale_factor_does_not_multiply_reals(tmp_path, points):
    """The sign of the scale factor means that coordinates are stored as reals, which are not multiplied by it."""
    file = read_c3d(write(tmp_path, build_c3d(points, LABELS, scale=-0.05, replace={"POINT:SCALE": [-0.04]})))
    np.testing.assert_allclose(stacked(file), points, rtol=1e-6)


def test_events_of_a_recording(shared):
    recording = read_c3d(shared / "real" / "c3d_edge" / "07_subject_labels.c3d")
    content = ezc3d.c3d(str(shared / "real" / "c3d_edge" / "07_subject_labels.c3d"))["parameters"]["EVENT"]
    times = content["TIMES"]["value"]
    expected = sorted(
        zip(60 * times[0] + times[1], content["LABELS"]["value"], content["CONTEXTS"]["value"], strict=True)
    )
    found = [(event.time, event.label, event.context) for event in recording.events]
    assert [item[1:] for item in found] == [item[1:] for item in expected]
    np.testing.assert_allclose([item[0] for item in found], [item[0] for item in expected])
    # On the recording's clock: the last foot strike is in it.
    assert recording.time[0] <= found[0][0] < found[-1][0] <= recording.time[-1]
