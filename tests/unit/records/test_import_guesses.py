"""Detection of columns, units and clocks, candidates in messages, and columns of other quantities."""

import numpy as np
import pytest
from foreign_files import FORCE, POSITION, RATE, TIME, rows

import lumbar
from refusing import has_tokens, refusal

HEAD = "time_s,position_mm,force_N\n"


def imported(tmp_path, text, name="trial.csv", **options):
    (tmp_path / name).write_text(text, encoding="utf-8")
    [recording] = lumbar.import_recordings(tmp_path / name, **options)
    return recording


def test_two_forces_need_choice(tmp_path):
    text = "t (s),z (mm),force 1 (N),force 2 (N)\n" + rows(",", columns=(TIME, POSITION, FORCE, 2 * FORCE))
    message = refusal(imported, tmp_path, text)
    assert has_tokens(message, "force … column 3 'force 1' [N] … column 4 'force 2' [N] … --force")
    assert has_tokens(message, "column 2 'z' [mm] … 1.26221, 1.4775, 1.67825 … -4.7325 … 4.73246")
    chosen = imported(tmp_path, text, force="force 2")
    assert chosen.record["output"] == pytest.approx(2 * FORCE, abs=2e-5)
    assert has_tokens(chosen.grounds["force"], "--force")
    # The header's own text, and a unit that is not the file's.
    text = text.replace("force 2 (N)", "force2_kN")
    chosen = imported(tmp_path, text, force="force2_kN", force_unit="N")
    assert chosen.record["output"] == pytest.approx(2 * FORCE, abs=2e-5)
    assert has_tokens(chosen.grounds["force"], "N … --force-unit … kN")


@pytest.mark.parametrize("head", ["time_s,position_mm,force_N,force_N\n", "t (s),z (mm),F (N),F (kN)\n"])
def test_duplicate_column_name_is_rejected(tmp_path, head):
    text = head + rows(",", columns=(TIME, POSITION, FORCE, FORCE / 1e3), digits=8)
    assert has_tokens(refusal(imported, tmp_path, text), "column 3 … column 4 … --force")
    name = "force" if "force" in head else "F"
    assert has_tokens(refusal(imported, tmp_path, text, force=name), f"force … '{name}' … 3 and 4 … --force")
    assert imported(tmp_path, text, force=3).record["output"] == pytest.approx(FORCE, abs=1e-5)


WHOLE = HEAD + rows(",")
CLOCKLESS = "position_mm,force_N\n" + rows(",", columns=(POSITION, FORCE))
TWO_RATES = "Sample rate: 200 Hz\nSampling interval: 4 ms\n" + CLOCKLESS
IN_MILLISECONDS = "time,position_mm,force_N\n" + rows(",", columns=(1e3 * TIME, POSITION, FORCE))
TWO_TABLES = WHOLE + "\nSecond cycle\n" + HEAD + rows(",", columns=(TIME, 2 * POSITION, FORCE))
MICROSECONDS = "time [µs],position [mm],force [N]\n" + rows(",")
THOUSANDS = "t (s);z (µm);F (N)\n" + "".join(
    f"{t:.3f};{1e3 * z:,.2f};{f:.4f}\n" for t, z, f in zip(TIME, POSITION, FORCE, strict=True)
)


def changed(lines: dict[int, str]) -> str:
    """The whole file with other lines in some places."""
    whole = WHOLE.splitlines()
    return "\n".join(lines.get(number, line) for number, line in enumerate(whole, start=1))


def stamped(moved: dict[int, int]) -> str:
    """The whole file in which some samples have the stamps of others."""
    time = TIME.copy()
    time[list(moved)] = TIME[list(moved.values())]
    return HEAD + rows(",", columns=(time, POSITION, FORCE))


@pytest.mark.parametrize(
    ("text", "options", "tokens"),
    [
        ("time_s,position,force_N\n" + rows(","), {}, "position … column 2 'position' … unit … --position-unit"),
        ("time_s,position_mm,load [V]\n" + rows(","), {}, "--force-unit '35.15 N' … --force-unit V"),
        ("time_s,a,b\n" + rows(","), {}, "--position … column 2 'a' … column 3 'b'"),
        (MICROSECONDS, {}, "2e+08 Hz … --time-unit"),
        (IN_MILLISECONDS, {}, "time … column 1 'time' … unit … --time-unit"),
        (CLOCKLESS, {}, "time … rate … --time COLUMN … --rate HZ"),
        *((f"{line}\n{CLOCKLESS}", {}, "--time COLUMN … --rate HZ") for line in (
            "Samples: 600", "Sample: 7", "Sample diameter 10 mm", "Sample rate: 60 per min", "Frequency: 2 Hz")),
        (TWO_RATES, {}, "200 Hz … line 1 … 250 Hz … line 2 … --rate HZ"),
        (WHOLE, {"rate": 100}, "--rate … column 1 'time' [s]"),
        (HEAD + rows(",", ","), {}, "commas … delimiters … decimal"),
        (TWO_TABLES, {}, "2 tables … 1 … lines 2 to 601 … 2 … lines 605 to 1204"),
        (TWO_TABLES, {"table": 3}, "table '3' … 1 … lines 2 to 601"),
        (changed({101: "0.495,over,1.2", 201: "0.995,1.2"}), {}, "line 101 … column 2 'position' … 'over'"),
        (changed({101: "0.495,over,1.2", 201: "0.995,1.2"}), {}, "line 201 … 2 cells … 3"),
        (THOUSANDS, {}, "column 2 … number … '1,262.21'"),
        ("position_mm,force_N\n" + rows(","), {}, "names … line … 'position_mm,force_N'"),
        (WHOLE, {"position": 2, "force": "2"}, "--force: column 2 'position' … role"),
        (WHOLE, {"position": "none"}, "--position 'none' … column 1 'time' [s]"),
        (WHOLE, {"force": "load"}, "--force 'load' … column 1 'time' [s]"),
        (WHOLE, {"force_unit": "mm"}, "--force-unit 'mm' … length … force"),
        (WHOLE, {"trim": (10, 20)}, "10 … 20 s … 0 … 2.995 s"),
        (WHOLE, {"trim": (2, 1)}, "--trim 2:1"),
        (WHOLE, {"rate": -1.0}, "--rate -1 … positive"),
        *((text, {}, "trial.csv … no table … 8 rows") for text in ("", "no numbers\nat all\n", "1,2,3\n2,3,4\n")),
        (stamped({50: 49, 120: 110}), {}, "line 52 … 1 … repeated"),
    ],
)  # fmt: skip
def test_missing_and_ambiguous_facts_are_reported(tmp_path, text, options, tokens):
    assert has_tokens(refusal(imported, tmp_path, text, **options), tokens)


def test_nameless_columns_have_roles_in_order(tmp_path):
    units = {"position_unit": "mm", "force_unit": "N"}
    coarse = np.round(POSITION, 1)
    of_three = imported(tmp_path, rows("\t", columns=(TIME, coarse, FORCE)), **units)
    of_two = imported(tmp_path, rows("\t", columns=(coarse, FORCE)), rate=RATE, **units)
    for one in (of_three, of_two):
        assert one.record["input"] == pytest.approx(coarse, abs=1e-9)
        assert one.record["output"] == pytest.approx(FORCE, abs=2e-5)
    assert all(has_tokens(ground, "order … time, position, force") for ground in of_three.grounds.values())
    assert has_tokens(of_two.grounds["force"], "order … position, force")
    assert not has_tokens(of_two.grounds["force"], "time, position, force")


@pytest.mark.parametrize(
    ("text", "options", "step", "factor"),
    [
        (MICROSECONDS, {"time_unit": "s"}, 1 / RATE, 1),
        (IN_MILLISECONDS, {"time_unit": "ms"}, 1 / RATE, 1),
        (TWO_RATES, {"rate": 250}, 0.004, 1),
        (WHOLE, {"rate": 100, "time": "none"}, 0.01, 1),
        (TWO_TABLES, {"table": 2}, 1 / RATE, 2),
    ],
)
def test_options_override_detection(tmp_path, text, options, step, factor):
    record = imported(tmp_path, text, **options).record
    assert record.sampling_time == pytest.approx(step)
    assert record["input"] == pytest.approx(factor * POSITION, abs=2e-5)


@pytest.mark.parametrize(
    ("line", "rate"),
    [
        ("Sampling frequency [kHz]: 0.2 kHz", 200),
        ("Abtastrate: 2,0E+2 Hz", 200),
        ("Abtastintervall = 5 ms", 200),
        ("Fréquence d'échantillonnage : 200 Hz", 200),
        ("# fs=200", 200),
        ("Delta_X\t0,005\t0,005", 200),
        ("Sampling Interval (s): 0.005", 200),
        ("Scan Rate = 200 samples/s", 200),
    ],
)
def test_rate_is_read_from_header_lines(tmp_path, line, rate):
    one = imported(tmp_path, f"{line}\nposition_mm;force_N\n" + rows(";", columns=(POSITION, FORCE)))
    assert 1 / one.record.sampling_time == pytest.approx(rate)
    assert has_tokens(one.grounds["time"], "200 Hz … line 1")


def test_inverted_force_is_noted_and_flipped(tmp_path):
    text = HEAD + rows(",", columns=(TIME, POSITION, -FORCE))
    assert "--flip-force" in imported(tmp_path, text).notes[0]
    flipped = imported(tmp_path, text, flip_force=True)
    assert flipped.record["output"] == pytest.approx(FORCE, abs=2e-5)
    assert [has_tokens(note, "sign … --flip-force") for note in flipped.notes] == [True]
    assert "--flip-force" in imported(tmp_path, HEAD + rows(","), flip_force=True).notes[1]


def noted(one, tokens: str) -> bool:
    return any(has_tokens(note, tokens) for note in one.notes)


def test_rows_outside_tables_are_noted(tmp_path):
    lines = (HEAD + rows(",")).splitlines()
    cut = imported(tmp_path, "\n".join([*lines[:-1], "2.995,1.2"]))
    assert has_tokens(cut.form, "lines 2 to 600") and noted(cut, "line 601 … 2.995")
    event = imported(tmp_path, "\n".join([*lines[:598], "Event: stop", *lines[598:]]))
    assert has_tokens(event.form, "lines 2 to 602") and noted(event, "line 599 … 'Event: stop'")
    assert event.record["output"] == pytest.approx(FORCE, abs=2e-5)


def test_gaps_and_restarts_of_the_clock_split_records(tmp_path):
    force, early, late = FORCE.copy(), TIME[:200], TIME[205:]
    force[200:205] = np.nan
    restarted = np.concatenate([early, TIME[:5], late - late[0]])
    for time in (TIME, restarted):
        (tmp_path / "trial.csv").write_text(HEAD + rows(",", columns=(time, POSITION, force)))
        one, two = lumbar.import_recordings(tmp_path / "trial.csv")
        assert (one.record.name, two.record.name) == ("trial_1", "trial_2")
        assert one.record.time == pytest.approx(early)
        assert two.record.time == pytest.approx(time[205:])
        assert two.record["output"] == pytest.approx(FORCE[205:], abs=2e-5)
        assert noted(two, "5 of 600 … force in 5 … line 202") and noted(two, "1 … line 207")


def test_rows_without_time_and_short_parts_are_left_out_with_notes(tmp_path):
    text = HEAD + rows(",")
    total = imported(tmp_path, f"{text},,{FORCE.sum():.4f}\n")
    assert len(total.record) == 600 and noted(total, "1 of 601 … line 602")
    means = imported(tmp_path, f"{text}1.4975,0.1,0.2\n")
    assert len(means.record) == 600 and noted(means, "1 … line 602 … 1 … 8")


@pytest.mark.parametrize("ramp_s", [0.1, 5.0])
def test_growing_steps_are_resampled(tmp_path, ramp_s):
    """Position and force of a ramp and a hold with logarithmic times agree with their formulas between the samples."""
    time = np.r_[np.linspace(0, ramp_s, 40)[:-1], ramp_s + np.r_[0, ramp_s * np.geomspace(0.05, 1000, 120)]]

    def position(t):
        return 2 * np.clip(t / ramp_s, 0, 1)

    def force(t):
        return position(t) * (1 + np.clip(t / ramp_s - 1, 0, None)) ** -0.2

    one = imported(tmp_path, HEAD + rows(",", columns=(time, position(time), force(time)), digits=9))
    record = one.record
    assert record.time[-1] > 0.999 * time[-1]
    assert record["input"] == pytest.approx(position(record.time), abs=0.02)
    assert record["output"] == pytest.approx(force(record.time), abs=0.02)
    assert noted(one, "160 … resampled")


def test_uneven_clock_is_resampled_with_note(tmp_path):
    """The recording at jittered instants with 10 samples dropped comes back on its even clock."""
    random = np.random.default_rng(1)
    time = TIME + random.uniform(-0.3, 0.3, len(TIME)) / RATE
    time = np.delete(time, random.choice(np.arange(20, 580), 10, replace=False))
    position = 4 * np.sin(2 * np.pi * 1.1 * time) + 1.5 * np.sin(2 * np.pi * 3.3 * time + 1)
    one = imported(tmp_path, HEAD + rows(",", columns=(time, position, 2 * position), digits=7))
    record = one.record
    assert np.ptp(np.diff(record.time)) < 1e-9
    expected = 4 * np.sin(2 * np.pi * 1.1 * record.time) + 1.5 * np.sin(2 * np.pi * 3.3 * record.time + 1)
    assert record["input"] == pytest.approx(expected, abs=0.02)  # a peak between two samples is cut
    assert np.std(record["input"] - expected) < 2e-3
    assert has_tokens(one.notes[0], "ms … 13 … resampled … 198 Hz")
    assert record.time[-1] > time[-1] - 1 / RATE


def test_resampled_values_stay_between_neighbours(tmp_path):
    """A sensor clipped at 750.02 once read 751.5 there: filters and splines ring at corners."""
    random = np.random.default_rng(3)
    time = np.round(TIME + random.uniform(-0.4, 0.4, len(TIME)) / RATE, 3)
    clipped = np.clip(1e3 * np.sin(2 * np.pi * 1.1 * time), -600, 750.02)
    text = HEAD + rows(",", columns=(time, POSITION, clipped), digits=3)
    record = imported(tmp_path, text, accept_clipped=True).record
    after = np.clip(np.searchsorted(time, record.time), 1, len(time) - 1)
    clipped = np.round(clipped, 3)
    assert np.all(record["output"] <= np.maximum(clipped[after - 1], clipped[after]))
    assert np.all(record["output"] >= np.minimum(clipped[after - 1], clipped[after]))


@pytest.mark.parametrize("rate", [1024.0, 600.0, 857.0, 300.0])
@pytest.mark.parametrize("options", [np.rint, np.floor])
def test_rounded_millisecond_stamps_give_even_clock(tmp_path, rate, options):
    time = np.arange(600) / rate
    whole = options(1e3 * time)
    text = "time_ms,position_mm,force_N\n" + rows(",", columns=(whole, POSITION, FORCE))
    one = imported(tmp_path, text)
    assert 1 / one.record.sampling_time == pytest.approx(rate, rel=3e-4)
    assert one.record["output"] == pytest.approx(FORCE, abs=2e-5)
    assert any(has_tokens(note, "1 ms") for note in one.notes)


def test_six_digit_stamps_give_even_clock(tmp_path):
    time = [f"{900 + 50 * sample / 512:.6g}" for sample in range(600 * 4)]
    lines = rows(",", columns=(np.tile(POSITION, 4), np.tile(FORCE, 4))).splitlines()
    text = HEAD + "".join(f"{stamp},{line}\n" for stamp, line in zip(time, lines, strict=True))
    assert 1 / imported(tmp_path, text).record.sampling_time == pytest.approx(512 / 50, rel=1e-5)


@pytest.mark.parametrize("rate", [1000.0, 500.0, 200.0])
def test_dropped_and_repeated_samples_are_not_rounding(tmp_path, rate):
    whole = np.rint(1e3 * np.arange(600) / rate)
    lines = ("time_ms,position_mm,force_N\n" + rows(",", columns=(whole, POSITION, FORCE))).splitlines()
    dropped = imported(tmp_path, "\n".join(lines[:300] + lines[301:]))
    assert has_tokens(dropped.notes[0], "1 … dropped")
    repeated = "\n".join(lines[:301] + lines[300:])
    assert has_tokens(refusal(imported, tmp_path, repeated), "line 302 … 1 … repeated")


def test_clipped_forces_are_rejected_unless_accepted(tmp_path):
    text = HEAD + rows(",", columns=(TIME, POSITION, np.clip(FORCE, -4, 4)))
    assert "clipped" in refusal(imported, tmp_path, text)
    assert imported(tmp_path, text, accept_clipped=True).clipped
    jittered = TIME + np.random.default_rng(2).uniform(-0.3, 0.3, len(TIME)) / RATE
    uneven = HEAD + rows(",", columns=(jittered, POSITION, np.clip(FORCE, -4, 4)))
    assert "clipped" in refusal(imported, tmp_path, uneven)


RADIAN = 2 * np.pi * 1.1
VELOCITY = 4 * RADIAN * np.cos(RADIAN * TIME)
"""Millimetres per second, of 4 mm · sin."""
MOTION = 4 * np.sin(RADIAN * TIME)
DRIVEN = 1.3 * MOTION + 0.02 * np.random.default_rng(5).normal(size=len(TIME))


def import_table(tmp_path, head, columns=(TIME, VELOCITY, DRIVEN), **options):
    (tmp_path / "trial.csv").write_text(head + "\n" + rows(",", columns=columns, digits=7), encoding="utf-8")
    [recording] = lumbar.import_recordings(tmp_path / "trial.csv", **options)
    return recording


@pytest.mark.parametrize(
    ("head", "options"),
    [
        ("time_s,v [mm/s],force_N", {}),
        ("time_s,speed/mm/s,force_N", {}),
        ("time_s,speed_mm_per_s,force_N", {}),
        ("time_s,Geschwindigkeit,force_N", {"position_unit": "mm/s"}),
        ("time_s,drive [V],force_N", {"position": "drive", "position_unit": "1 mm/s"}),
    ],
)
def test_velocity_is_integrated_with_note(tmp_path, head, options):
    one = import_table(tmp_path, head, **options)
    step = 1 / RATE
    assert one.record["input"][0] == 0
    assert one.record["input"] == pytest.approx(MOTION, abs=step**2 / 12 * np.ptp(RADIAN * VELOCITY) + 1e-6)
    assert list(one.frame()) == ["time_s", "position_mm", "force_N"]
    [note] = [note for note in one.notes if "integral" in note]
    assert has_tokens(note, "0 … unknown … drift")


def test_position_is_preferred_to_velocity(tmp_path):
    one = import_table(
        tmp_path, "time_s,v [mm/s],z [mm],force_N", columns=(TIME, VELOCITY, MOTION + 3, DRIVEN)
    )
    assert one.record["input"] == pytest.approx(MOTION + 3, abs=1e-6)
    columns = (TIME, VELOCITY, MOTION + 3, DRIVEN)
    two = import_table(tmp_path, "time_s,v [mm/s],z [mm],force_N", columns=columns, position="v")
    assert two.record["input"][0] == 0


def test_unclear_velocities_need_choice(tmp_path):
    head, columns = "time_s,v1 [mm/s],v2 [mm/s],force_N", (TIME, VELOCITY, VELOCITY, DRIVEN)
    tokens = "position … column 2 'v1' [mm/s] … column 3 'v2' [mm/s] … --position"
    assert has_tokens(refusal(import_table, tmp_path, head, columns=columns), tokens)
    assert has_tokens(
        refusal(import_table, tmp_path, "time_s,velocity,force_N"),
        "column 2 'velocity' … --position-unit … mm/s",
    )
    note = import_table(tmp_path, "time_s,velocity,force_N", position="velocity", position_unit="mm").notes[0]
    assert has_tokens(note, "column 2 'velocity' … position … --position-unit mm/s")


def test_parts_share_zero_of_integration(tmp_path):
    """If samples are missing before a part, it has its own zero, with a note."""
    whole = import_table(tmp_path, "time_s,v [mm/s],force_N").record
    part = import_table(tmp_path, "time_s,v [mm/s],force_N", trim=(1, 2)).record
    assert part["input"] == pytest.approx(whole["input"][200:400])
    gap = VELOCITY.copy()
    gap[50:54] = np.nan
    part = import_table(tmp_path, "time_s,v [mm/s],force_N", columns=(TIME, gap, DRIVEN), trim=(1, 2))
    assert part.record["input"] == pytest.approx(whole["input"][200:400] - whole["input"][54])
    assert noted(part, "0 … line 56")


def test_velocity_is_integrated_on_uneven_clock(tmp_path):
    time = TIME + np.random.default_rng(2).uniform(-0.4, 0.4, len(TIME)) / RATE
    speed = 4 * RADIAN * np.cos(RADIAN * time)
    record = import_table(tmp_path, "time_s,v [mm/s],force_N", columns=(time, speed, DRIVEN)).record
    expected = 4 * (np.sin(RADIAN * record.time) - np.sin(RADIAN * time[0]))
    assert record["input"] == pytest.approx(expected, abs=0.02)


READ = {"position_unit": "V", "force_unit": "V", "time": "none", "rate": 10.0}


@pytest.fixture
def tank(tmp_path):
    pump = np.random.default_rng(0).standard_normal((400, 1)).cumsum(axis=0) / 5
    level = 0.5 * pump + 0.01 * np.random.default_rng(1).standard_normal(pump.shape)
    path = tmp_path / "tank.csv"
    np.savetxt(path, np.hstack([pump, level]), delimiter=",", header="pump,level", comments="", fmt="%.5f")
    return path


def test_reading_in_volts_keeps_its_name(tank, tmp_path):
    imported = lumbar.import_recordings(tank, position="pump", force="level", **READ)
    imported.save(tmp_path / "out")
    assert (tmp_path / "out/tank.csv").read_text().startswith("time_s,pump_V,level_V\n")
    (record,) = imported.records
    assert [channel.label for channel in record.channels.values()] == ["Pump (V)", "Level (V)"]
    settings = lumbar.load_settings(tmp_path / "out/study.yaml")
    (read,) = lumbar.read(tmp_path / "out/tank.csv", layout=settings.tissue.layout)
    assert [channel.quantity for channel in read.channels.values()] == ["pump", "level"]


def test_forward_import_puts_load_first(tank, tmp_path):
    imported = lumbar.import_recordings(tank, position="level", force="pump", **READ)
    imported.save(tmp_path / "out", forward=True)
    assert (tmp_path / "out/tank.csv").read_text().startswith("time_s,pump_V,level_V\n")


def test_position_and_force_keep_names_in_volts(tmp_path):
    path = tmp_path / "cell.csv"
    rows = [(0.01 * n, n % 7, n % 5) for n in range(200)]
    np.savetxt(path, rows, delimiter=",", header="Time (s),Displacement,Load cell", comments="", fmt="%.5f")
    found = lumbar.import_recordings(path, position_unit="V", force_unit="V")
    assert list(found[0].names.values()) == ["time_s", "position_V", "force_V"]
