"""The public data sets as records: which files, columns and units, and what is fitted."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

import lumbar
from lumbar.interface.reading import read_listed
from lumbar.records.record import Channel, Record, RecordSet
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import ImprovementSettings
from running import PROJECT

Read = tuple[RecordSet, dict[str, Any]]
"""Records, and keywords of `lumbar.diagnose`."""
FORCE_IN = StudySettings(improvement=ImprovementSettings(forward=True))


def positioning_axis(folder: Path) -> Read:
    """Position to force, at a rate above twice the 80 Hz of the published low-pass filter."""
    columns = {
        "time": ColumnSettings(column="t", unit="s", quantity="time"),
        "input": ColumnSettings(column="qm", unit="mm", quantity="position", scale=1000.0),
        "output": ColumnSettings(
            column="vir", unit="N", quantity="force", scale=35.15065188
        ),  # gtau of the file, N/V
    }
    files = [folder / "positioning_axis" / f"{name}.mat" for name in ("DATA_EMPS", "DATA_EMPS_PULSES")]
    layout = ColumnLayout(columns=columns, format="mat")
    records = lumbar.read(files, layout=layout, rate=200.0, names=("reference", "pulses"))
    return records, {"train": "reference"}


def coupled_drives(folder: Path, number: int) -> Read:
    """Voltage to speed as the sensor gives it; one record, whose last part is the unseen one."""
    content = loadmat(folder / "coupled_drives" / "drive.mat", squeeze_me=True)
    voltage, speed = content[f"u{number}"].astype(float), content[f"z{number}"]
    record = _record("prbs", 0.02, (voltage, "voltage", "V"), (speed, "speed", "V"))
    return RecordSet([record]), {"settings": FORCE_IN}


def bouc_wen(folder: Path, forward: bool) -> Read:
    """Displacement to force, or the other way round as it was simulated."""
    records = []
    for name, force, displacement in (
        ("train", *_bouc_wen_training(folder)),
        ("unseen", *_bouc_wen_unseen(folder)),
    ):
        channels = ((displacement * 1000.0, "displacement", "mm"), (force, "force", "N"))
        records.append(_record(name, 1 / 750.0, *(channels[::-1] if forward else channels)))
    return RecordSet(records), {"train": "train", "settings": FORCE_IN if forward else None}


def _bouc_wen_training(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    # HDF5, but its two vectors lie in it whole and uncompressed, here: no HDF5 library is needed.
    path, samples = folder / "bouc_wen" / "train.h5", 40960
    return tuple(np.fromfile(path, "<f8", samples, offset=offset) for offset in (2432, 330384))


def _bouc_wen_unseen(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    names = ("uval_multisine", "yval_multisine")
    return tuple(loadmat(folder / "bouc_wen" / f"{name}.mat", squeeze_me=True)[name] for name in names)


def silverbox(folder: Path) -> Read:
    """Nine realisations of the multisine to learn from; the tenth, the arrow and the arrow within their range unseen."""
    table = np.genfromtxt(folder / "silverbox" / "SNLS80mV.csv", delimiter=",", skip_header=1, usecols=(0, 1))
    places = {f"multisine_{k + 1}": 41_150 + 8692 * k for k in range(10)}
    slices = {name: slice(first, first + 8192) for name, first in places.items()}
    slices |= {"arrow": slice(100, 40_575), "arrow_inside": slice(100, 32_100)}
    records = [
        _record(name, 2**14 / 1e7, *((1000 * table[part, column], "voltage", "mV") for column in (0, 1)))
        for name, part in slices.items()
    ]
    return RecordSet(records), {"train": [*places][:9], "settings": FORCE_IN}


def wiener_hammerstein(folder: Path) -> Read:
    """The official split; of the test part the first thousand samples do not count."""
    content = loadmat(folder / "wiener_hammerstein" / "WienerHammerBenchMark.mat", squeeze_me=True)
    signals = content["uBenchMark"], content["yBenchMark"]
    records = [
        _record(name, 1 / 51_200, *((1000 * signal[part], "voltage", "mV") for signal in signals))
        for name, part in (("train", slice(0, 100_000)), ("unseen", slice(100_000, None)))
    ]
    return RecordSet(records), {"train": "train", "settings": FORCE_IN}


def cascaded_tanks(folder: Path) -> Read:
    """Voltage of the pump to level of the lower tank, from two unknown levels."""
    table = np.genfromtxt(
        folder / "cascaded_tanks" / "dataBenchmark.csv", delimiter=",", skip_header=1, usecols=range(4)
    )
    records = [
        _record(name, 4.0, (table[:, first], "voltage", "V"), (table[:, first + 2], "level", "V"))
        for first, name in enumerate(("estimation", "validation"))
    ]
    return RecordSet(records), {"train": "estimation", "settings": FORCE_IN}


def davinci_tool_friction(folder: Path) -> Read:
    """As in the study of the project."""
    return _study(folder, "davinci_tool")


def friction_damper(folder: Path) -> Read:
    """As in the study of the project, but fitted to four of the sines together, as the published models are."""
    records, keywords = _study(folder, "friction_damper")
    unseen = ("sine_1Hz_38mm", "sine_1Hz_13mm")
    return records, {**keywords, "train": [name for name in records.names if name not in unseen]}


def _study(folder: Path, name: str) -> Read:
    settings = lumbar.load_settings(PROJECT / "config" / "studies" / f"{name}.yaml")
    tissue = settings.tissue
    files = [folder / entry.file for entry in tissue.records]
    records = read_listed(files, tissue.records, tissue.layout, tissue.rate_Hz)
    return records, {"settings": settings}


def _record(name: str, step: float, *channels: tuple[np.ndarray, str, str]) -> Record:
    roles = dict(zip(("input", "output"), (Channel(*channel) for channel in channels), strict=True))
    return Record(name, step * np.arange(len(channels[0][0])), roles, source=name)


READERS = {
    "positioning_axis": positioning_axis,
    "coupled_drives_1": lambda folder: coupled_drives(folder, 1),
    "coupled_drives_2": lambda folder: coupled_drives(folder, 2),
    "coupled_drives_3": lambda folder: coupled_drives(folder, 3),
    "bouc_wen_inverse": lambda folder: bouc_wen(folder, forward=False),
    "bouc_wen_forward": lambda folder: bouc_wen(folder, forward=True),
    "silverbox": silverbox,
    "wiener_hammerstein": wiener_hammerstein,
    "cascaded_tanks": cascaded_tanks,
    "davinci_tool_friction": davinci_tool_friction,
    "friction_damper": friction_damper,
}
"""Reader of each entry of ``expectations.toml``; takes the folder ``real``."""
