"""Experiments of the twin's pendulums as records."""

from __future__ import annotations

from lumbar.records.record import Channel, Record

ROLES = {
    "angle_rad": ("input", "angle", "rad"),
    "moment_Nm": ("output", "moment", "N m"),
    "box_held": ("box_held", "share of the box held", "1"),
    "length_m": ("length", "length", "m"),
    "pivot_acceleration_x_m_s2": ("pivot_acceleration_x", "acceleration", "m/s²"),
    "pivot_acceleration_z_m_s2": ("pivot_acceleration_z", "acceleration", "m/s²"),
}


def records_of(tables: dict) -> list[Record]:
    """Return records from their columns by name, as `pendulum_experiments` makes them."""
    records = []
    for name, columns in tables.items():
        channels = {
            ROLES[key][0]: Channel(values, *ROLES[key][1:])
            for key, values in columns.items()
            if key != "time_s"
        }
        records.append(Record(name, columns["time_s"], channels, name))
    return records
