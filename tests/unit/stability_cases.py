"""Made pendulums of a lift, for tests of basins: trajectories, tables and files."""

import json

import pandas as pd
from lifting_cases import minimum_jerk

from lumbar.lifting.movement.pendulum_states import THESIS_CHOICE
from lumbar.lifting.stability.model.pendulum_trajectories import COMS, PLANES
from lumbar.settings.lifting import StabilitySettings
from study_settings import changed

SETTINGS = changed(
    StabilitySettings(),
    pendulum={"sign": "hanging"},
    regulator={"control_weight": 1e-3},
    knots=201,
    checks=["simulation", "thesis_method", "proof"],
    proof={"margin_1_s": 0.05},
    thesis_method={"knots": 5},
    attack={"starts": 400, "control_overstated": 0.3},
    fewer_knots=101,
    lyapunov_shares=[0.0, 1.0],
)


def lift(subject="expert", box=23.0, mass=33.0, duration=1.5):
    return [
        minimum_jerk(
            subject=subject, box=box, com=com, plane=plane, mass=mass, duration=duration, start=start
        )
        for com in COMS
        for plane, start in zip(PLANES, (0.1, 0.4), strict=True)
    ]


def states_and_facts(items):
    columns = {
        "com": "com",
        "plane": "plane",
        "time": "time_s",
        "angle": "angle_rad",
        "angular_velocity": "angular_velocity_rad_s",
        "angular_acceleration": "angular_acceleration_rad_s2",
    }
    frames = [
        pd.DataFrame({column: getattr(item, name) for name, column in columns.items()}) for item in items
    ]
    facts = {
        "subject": "expert",
        "experience": "expert",
        "box_mass_kg": 23,
        "pivot": "mid_ankle",
        "segment_ends": "inner",
        "deposit_start": "descent",
        "mass_kg": {com: {"with_box": 40.0, "without_box": 17.0} for com in COMS},
        "length_m": {com: dict.fromkeys(PLANES, 1.1) for com in COMS},
        "box": {"share": "by_mass"},
    }
    return pd.concat(frames), facts


def add_thesis(facts, length_m=1.1):
    """Facts with pendulums by the thesis's choice too."""
    lengths = {com: dict.fromkeys(PLANES, length_m) for com in COMS}
    return facts | {"thesis_pendulum": {**vars(THESIS_CHOICE), "length_m": lengths, "missing": {}}}


def write_lift_states(folder, states, facts):
    """Write the files of a lift that `lumbar.basins` reads."""
    folder.mkdir(exist_ok=True)
    names = ("pendulum", "thesis_pendulum") if "thesis_pendulum" in facts else ("pendulum",)
    for name in names:
        states.to_csv(folder / f"{name}.csv", index=False)
    (folder / "pendulum.json").write_text(json.dumps(facts), encoding="utf-8")
    return folder / "pendulum.csv"
