"""Blind experiments on pendulums: swings with one hidden effect, by the mechanics of `lumbar.twin.hip_moment`."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lumbar.records.record import Channel, Record
from lumbar.twin.hip_moment import AT_REST, Mass, Signal, Swing, acceleration, constant, rate

EFFECTS = ("hand_load", "passive_stiffness", "coulomb_friction", "variable_length", "moving_pivot", "drag")
"""Effects that may be hidden."""
SAMPLING_TIME = 0.01
PERIOD, PERIODS = 8.0, 8


@dataclass(frozen=True, eq=False)
class PendulumExperiment:
    """Records of one pendulum and the truth about them."""

    records: dict[str, dict[str, np.ndarray]]
    """Columns (`time_s`, `angle_rad`, `moment_Nm` and further ones) of every record by its name."""
    effect: str
    variant: str
    """Name of the hidden effect, or empty."""
    noise_rms: float
    """N·m."""
    truth: dict[str, float]
    """Parameters of what is hidden, where they have a name of their own: mass and distance of a box, mass of the body."""


@dataclass
class _Hidden:
    """Changes of the swing, additional moment and measured columns of an effect."""

    variant: str = ""
    length: Signal | None = None
    box: Mass | None = None
    pivot_x: Signal = AT_REST
    pivot_z: Signal = AT_REST
    added: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    columns: dict[str, Signal] = field(default_factory=dict)
    truth: dict[str, float] = field(default_factory=dict)


def make_pendulum_experiment(
    effect: str, seed: int, strength: float = 8.0, columns: bool = True, periodic: bool = True
) -> PendulumExperiment:
    """Make one experiment with one of `EFFECTS`, or none where empty.

    `strength` is the RMS that the best pendulum without the effect leaves of the first record, over the noise; where nothing is
    hidden, the share of the noise in the moment is drawn. `columns`: box, length or pivot are measured, where the effect is
    theirs. `periodic`: the first record repeats, so that it shows its noise floor.
    """
    draw = np.random.default_rng([seed, EFFECTS.index(effect) if effect else 99, columns, periodic])
    body = {
        "kg": draw.uniform(25, 60),
        "length": draw.uniform(0.25, 0.5),
        "central_inertia": draw.uniform(0.5, 3.0),
        "damping": draw.uniform(2.0, 12.0),
        "hanging": draw.random() < 0.5,
    }
    hidden = _draw_hidden(effect, body, draw, columns)
    swings = {
        "sway": (PERIOD * PERIODS, _swing(draw, periodic)),
        "swings": (24.0, _swing(draw, False)),
        "reaching": (20.0, _swing(draw, False, slower=2.0)),
    }
    records, noise = {}, 0.0
    for name, (duration, angle) in swings.items():
        time = np.arange(round(duration / SAMPLING_TIME)) * SAMPLING_TIME
        moment = _moment(time, angle, body, hidden)
        if not noise:
            left = _pendulum_residual(time, angle, moment)
            noise = left / strength if effect else draw.uniform(0.005, 0.1) * moment.std()
        measured = moment + noise * draw.standard_normal(len(time))
        additional = {key: signal(time) for key, signal in hidden.columns.items()}
        records[name] = {"time_s": time, "angle_rad": angle(time), "moment_Nm": measured, **additional}
    return PendulumExperiment(records, effect, hidden.variant, noise, {"body_kg": body["kg"], **hidden.truth})


def _swing(draw, periodic: bool, slower: float = 1.0) -> Signal:
    """Sum of sines up to 1.5 Hz about a leaning posture; lines of the period, or unrelated ones."""
    lines = np.arange(1, 13) / PERIOD if periodic else draw.uniform(0.06, 1.5 / slower, 14)
    size, phase = lines**-0.7, draw.uniform(0, 2 * np.pi, len(lines))
    grid = np.arange(0, 60, 0.02)
    largest = np.abs(np.cos(2 * np.pi * np.outer(grid, lines) + phase) @ size).max()
    amplitude, lean = draw.uniform(0.5, 0.9), draw.uniform(0.0, 0.25)

    def angle(time):
        waves = np.cos(2 * np.pi * np.multiply.outer(time, lines) + phase) @ size
        return lean + amplitude * waves / largest

    return angle


def _moment(time: np.ndarray, angle: Signal, body: dict, hidden: _Hidden) -> np.ndarray:
    length = hidden.length or constant(body["length"])
    follows = length if hidden.variant != "with_the_angle" else lambda instant: length(angle(instant))
    masses = (Mass(body["kg"], follows), *((hidden.box,) if hidden.box else ()))
    swing = Swing(angle, masses, body["central_inertia"], body["hanging"], hidden.pivot_x, hidden.pivot_z)
    moment = swing.moment(time) + body["damping"] * rate(angle, time)
    if hidden.added is not None:
        moment = moment + hidden.added(angle(time), rate(angle, time))
    return moment


def _pendulum_residual(time, angle, moment) -> float:
    columns = np.stack([acceleration(angle, time), rate(angle, time), np.sin(angle(time))], axis=1)
    return float(np.std(moment - columns @ np.linalg.lstsq(columns, moment, rcond=None)[0]))


def _draw_hidden(effect: str, body: dict, draw, columns: bool) -> _Hidden:
    if not effect:
        return _Hidden()
    return _DRAWN[effect](body, draw, columns)


def _hand_load(body, draw, columns) -> _Hidden:
    grasp, release = draw.uniform(2, 8), draw.uniform(13, 18)
    takes = draw.uniform(0.05, 0.2)

    def box_share(time):
        rising = np.clip((time - grasp) / takes, 0, 1) - np.clip((time - release) / takes, 0, 1)
        return np.sin(0.5 * np.pi * rising) ** 2

    mass, distance = draw.uniform(5, 20), draw.uniform(0.3, 0.6)
    return _Hidden(
        "box",
        box=Mass(mass, constant(distance), box_share),
        columns={"box_held": box_share} if columns else {},
        truth={"box_kg": mass, "box_m": distance},
    )


def _passive_stiffness(body, draw, columns) -> _Hidden:
    variant = str(draw.choice(["exponential", "one_sided", "cubic", "offset"]))
    end, angle = draw.uniform(20, 80), draw.uniform(0.2, 0.5)  # N·m at 0.9 rad, and how fast it gets there
    laws = {
        "exponential": lambda theta, _: end * np.sinh(theta / angle) / np.sinh(0.9 / angle),
        "one_sided": lambda theta, _: end * np.exp((theta - 0.9) / angle),
        "cubic": lambda theta, _: end * (theta / 0.9) ** 3,
        "offset": lambda theta, _: end * (theta - angle) / 0.9,
    }
    return _Hidden(variant, added=laws[variant])


def _coulomb_friction(body, draw, columns) -> _Hidden:
    variant = str(draw.choice(["sign", "smoothed", "stribeck"]))
    limit, speed = draw.uniform(3, 15), draw.uniform(0.02, 0.1)
    laws = {
        "sign": lambda _, omega: limit * np.sign(omega),
        "smoothed": lambda _, omega: limit * omega / np.sqrt(omega**2 + speed**2),
        "stribeck": lambda _, omega: limit * np.tanh(omega / speed) * (1 + 0.8 / (1 + (omega / 0.5) ** 2)),
    }
    return _Hidden(variant, added=laws[variant])


def _variable_length(body, draw, columns) -> _Hidden:
    mean, share = body["length"], draw.uniform(0.1, 0.25)
    frequency, phase = draw.uniform(0.1, 0.7, 3), draw.uniform(0, 2 * np.pi, 3)
    if columns:

        def stretched(time):
            waves = np.sin(2 * np.pi * np.multiply.outer(time, frequency) + phase).sum(axis=-1) / 3
            return mean * (1 + share * waves)

        return _Hidden("measured", length=stretched, columns={"length_m": stretched})
    if draw.random() < 0.5:
        sign = draw.choice([-1.0, 1.0])
        return _Hidden("with_the_angle", length=lambda theta: mean * (1 + sign * share * theta))
    return _Hidden(
        "oscillating",
        length=lambda time: mean * (1 + 0.7 * share * np.sin(2 * np.pi * frequency[0] * time + phase[0])),
    )


def _moving_pivot(body, draw, columns) -> _Hidden:
    frequency, phase = draw.uniform(0.15, 1.2, 4), draw.uniform(0, 2 * np.pi, 4)
    size = draw.uniform(0.01, 0.04, 2)
    if columns:

        def place(index):
            return lambda time: (
                size[index]
                * np.sin(
                    2 * np.pi * np.multiply.outer(time, frequency[2 * index : 2 * index + 2])
                    + phase[2 * index : 2 * index + 2]
                ).sum(axis=-1)
            )

        x, z = place(0), place(1)
        measured = {
            "pivot_acceleration_x_m_s2": lambda time: acceleration(x, time),
            "pivot_acceleration_z_m_s2": lambda time: acceleration(z, time),
        }
        return _Hidden("measured", pivot_x=x, pivot_z=z, columns=measured)

    def sway(time):
        return size[0] * np.sin(2 * np.pi * frequency[0] * time + phase[0])

    along = str(draw.choice(["swaying", "heaving"]))
    return _Hidden(along, **{"pivot_x" if along == "swaying" else "pivot_z": sway})


def _drag(body, draw, columns) -> _Hidden:
    variant = str(draw.choice(["quadratic", "power"]))
    size, power = draw.uniform(3, 12), 2.0 if variant == "quadratic" else draw.uniform(1.7, 2.6)
    return _Hidden(variant, added=lambda _, omega: size * np.sign(omega) * np.abs(omega) ** power)


_DRAWN = dict(
    zip(
        EFFECTS,
        (_hand_load, _passive_stiffness, _coulomb_friction, _variable_length, _moving_pivot, _drag),
        strict=True,
    )
)


ROLES = {
    "angle_rad": ("input", "angle", "rad"),
    "moment_Nm": ("output", "moment", "N m"),
    "box_held": ("box_held", "share of the box held", "1"),
    "length_m": ("length", "length", "m"),
    "pivot_acceleration_x_m_s2": ("pivot_acceleration_x", "acceleration", "m/s²"),
    "pivot_acceleration_z_m_s2": ("pivot_acceleration_z", "acceleration", "m/s²"),
}


def records_of(tables: dict) -> list[Record]:
    """Return records from their columns by name."""
    records = []
    for name, columns in tables.items():
        channels = {
            ROLES[key][0]: Channel(values, *ROLES[key][1:])
            for key, values in columns.items()
            if key != "time_s"
        }
        records.append(Record(name, columns["time_s"], channels, name))
    return records
