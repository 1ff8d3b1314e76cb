"""``lumbar.inspect``: content of a marker file, its faults, and the result of the pipeline."""

import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.files import replacing
from lumbar.interface.lift import Lift, lift
from lumbar.interface.reading import read
from lumbar.lifting.movement.lift_analysis import NEW_STUDY, analyse_lift
from lumbar.lifting.movement.rigid_filling import BodyFilling
from lumbar.lifting.quality.body import THIGH, find_body_axes, landmarks
from lumbar.lifting.quality.gate import usable_markers
from lumbar.lifting.quality.screening import (
    QualitySheet,
    Screening,
    meant_labels,
    naming,
    quality_sheet,
    sheet_of,
)
from lumbar.records.marker_axes import check_axes, rotation_to_standard
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.records.unpacking import ending_of
from lumbar.settings.layout import Axis, MarkerLayout
from lumbar.settings.lifting import REFINING, LiftingSettings, SubjectSettings, TrialSettings

_STAND_IN = SubjectSettings(
    name="nobody", sex="unknown", mass_kg=70.0, height_m=1.7, experience="unknown", trials=()
)
"""Subject for the pipeline: events and gaps of a recording do not depend on the subject."""
_MAX_FRAMES = 1000
"""Frames that show the axes of the body."""


def inspect(
    path: str | os.PathLike,
    *,
    settings: LiftingSettings | None = None,
    height_m: float | None = None,
) -> "Inspected":
    """Report on a marker file without computing results from it.

    The axes are those of the settings; without settings those of the body in the file.

    Parameters
    ----------
    path : path
        C3D, TRC, CSV or BVH file with markers, also packed (``.gz``).
    settings : LiftingSettings, optional
        Rules for reading markers and filling gaps.
    height_m : float, optional
        Stature of the subject, with which lengths of the body are compared.

    Raises
    ------
    InputError
        A file that cannot be read, or that is a record of force and position.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_lift
    >>> somebody = example_lift("lift.c3d")
    >>> found = lumbar.inspect("lift.c3d", height_m=somebody.height_m)
    >>> found.sheet.findings
    ()
    >>> print(found.axes)
    up +z, forward +y
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the files in it, e.g. {path}/*.c3d")
    chosen = settings or LiftingSettings()
    layout = chosen.markers
    seen = _read(path, chosen, height_m)
    # The axes of the body, from the markers that are not left out.
    usable = usable_markers(seen.screening.points, seen.screening.findings)
    found = _body_axes(usable, meant_labels(layout.aliases, usable), layout)
    up, forward = found or (layout.up, layout.forward)
    axes, rotated = f"up {up}, forward {forward}", None
    if found is None:
        axes += " by the settings; the labels do not show the body's"
    elif found != (layout.up, layout.forward):
        markers = layout.model_copy(update={"up": up, "forward": forward})
        rotated = chosen.model_copy(update={"markers": markers})
    # Without settings the file is read again in these axes; otherwise the pipeline keeps those of the settings.
    if rotated is not None and settings is None:
        chosen, seen = rotated, _read(path, rotated, height_m)
    pipeline = _run_pipeline(path, seen, chosen)
    if rotated is not None and settings is not None:
        axes += f" by the body, but up {layout.up} and forward {layout.forward} in the settings"
        seen = _read(path, rotated, height_m)
    recording, screening = seen.recording, seen.screening
    return Inspected(
        sheet=quality_sheet(recording, screening.points, screening.findings, screening.unchecked),
        axes=axes,
        pipeline=pipeline,
        points=screening.points,
        time=recording.time,
        meant=meant_labels(layout.aliases, screening.points),
        prefixes=recording.subjects,
    )


@dataclass(frozen=True)
class _ReadFile:
    """A marker file that is read a single time, for the sheet and for the pipeline."""

    recording: MarkerRecording
    screening: Screening
    bodies: BodyFilling


def _read(path: Path, settings: LiftingSettings, height_m: float | None) -> _ReadFile:
    screening, bodies = Screening(height_m, settings.markers.aliases, refuse=False), BodyFilling(settings)
    layout = settings.markers.model_copy(update={"required": (), "check_axes": False})
    try:
        recording = read_markers(path, layout, screen=screening, repair=bodies)
    except InputError as error:
        _refuse_record(path, error)
        raise
    if set(screening.points) == {"position"}:  # the columns position_x_mm, … of a record
        _refuse_record(path)
    return _ReadFile(recording, screening, bodies)


def _refuse_record(path: Path, cause: InputError | None = None) -> None:
    """Raise `InputError` if the file is a record of force and position."""
    if ending_of(path) not in (".csv", ".txt", ".mat"):
        return
    try:
        read(path)
    except InputError:
        return
    raise InputError(
        f"{path}: a record of a force and a position, no markers; lumbar diagnose {path.parent} examines records"
    ) from cause


def _body_axes(
    points: dict[str, np.ndarray], meant: dict[str, str], layout: MarkerLayout
) -> tuple[Axis, Axis] | None:
    """Return the axes of the file by the body in it, after the inverse of the settings' rotation."""
    named = {label: landmark for landmark, label in landmarks(points, meant).items()}
    rotation = rotation_to_standard(layout.up, layout.forward)
    every = max(1, max(map(len, points.values()), default=0) // _MAX_FRAMES)
    return find_body_axes({label: points[label][::every] @ rotation for label in named}, named)


def _run_pipeline(path: Path, seen: _ReadFile, settings: LiftingSettings) -> tuple[bool, str]:
    """Return whether a lift is analysed with these settings, and its events or the reason why not."""
    recording, screening, bodies = seen.recording, seen.screening, seen.bodies
    layout, trial = settings.markers, TrialSettings(box_mass_kg=0.0, markers=path.name)
    subject = _STAND_IN.model_copy(update={"height_m": screening.height_m or _STAND_IN.height_m})
    try:
        if layout.required != ():
            return True, str(lift(path, subject, 0.0, settings=settings))
        with naming(path):
            screening.raise_errors()
            if layout.check_axes:
                check_axes(recording.positions, layout, str(path))
            sheet = sheet_of(recording, screening, layout)
        sheet = replace(sheet, findings=(*sheet.findings, *bodies.findings))
        analysed = analyse_lift(recording, subject, trial, settings, bodies.gaps, sheet.findings)
        return True, str(Lift(analysed, subject, trial, settings, "", sheet))
    except (InputError, NumericalError) as error:
        return False, str(error)


def check_picture(path: Path) -> None:
    """Raise `InputError` for a picture in a format that is not written."""
    if path.suffix not in (".svg", ".pdf"):
        raise InputError(f"{path}: pictures are written as .svg or .pdf")


@dataclass(frozen=True, eq=False, repr=False)
class Inspected:
    """Report on a marker file."""

    sheet: QualitySheet
    """Content of the file, its faults, and the use of its markers."""
    axes: str
    """Axes that point up and forward."""
    pipeline: tuple[bool, str]
    """Whether the pipeline analyses it as a lift; the detected events, or the reason why not."""
    points: dict[str, np.ndarray]
    """Shape (n_frames, 3): measured markers by the file's labels; metres, x to the right, y forward, z up."""
    time: np.ndarray
    """Shape (n_frames,)."""
    meant: dict[str, str]
    """Standard name to the label that fills it without others."""
    prefixes: tuple[str, ...]
    """Prefixes of subjects, removed from the labels."""

    def as_dict(self) -> dict:
        """Return all but the trajectories as data for JSON."""
        runs, words = self.pipeline
        return {
            "schema": "lumbar.inspected/1",
            **self.sheet.as_dict(),
            "prefixes": list(self.prefixes),
            "axes": self.axes,
            "filled": dict(self.meant),
            "analysed": runs,
            "pipeline": words,
        }

    def lines(self) -> list[str]:
        """Return all but the trajectories as text."""
        sheet, (runs, words) = self.sheet, self.pipeline
        filled = [name if name == label else f"{name} = {label}" for name, label in self.meant.items()]
        # Landmarks with usual labels that the file has and no alias of the settings uses.
        free = landmarks([label for label in sheet.unused if label not in THIGH])
        recognised = {name: label for name, label in free.items() if name in sheet.absent}
        suggested = ", ".join(f"{name} = {label}" for name, label in recognised.items())
        if suggested and NEW_STUDY not in words:
            suggested += f"; {NEW_STUDY} writes the aliases"
        unused = ", ".join(sheet.unused)
        lists = {
            "subjects' prefixes removed": ", ".join(self.prefixes),
            "axes": self.axes,
            "standard markers": ", ".join(filled) or "none",
            "recognised, but no alias names it": suggested,
            "estimated": "; ".join(f"{name} ({rule})" for name, rule in sheet.estimated.items()),
            "without (name their labels in markers.aliases)": ", ".join(
                name for name in sheet.absent if name not in (*recognised, *REFINING)
            ),
            "unused": "" if unused in words else unused,
            "as a lift": "analysed" if runs else "rejected",
        }
        lines = [*sheet.lines(), *(f"{subject}: {text}" for subject, text in lists.items() if text)]
        return [*lines, *(f"  {line}" for line in words.splitlines())]

    def save_picture(self, path: str | os.PathLike) -> None:
        """Draw heights, gaps and findings into a file ``.svg`` or ``.pdf``."""
        from lumbar.publishing.figures.movement_figures import quality_figure
        from lumbar.publishing.figures.style import save

        path = Path(path)
        check_picture(path)
        figure = quality_figure(self.sheet, self.points, self.time, self.meant)
        with TemporaryDirectory() as folder, replacing(path) as temporary:
            save(figure, Path(folder, "picture"), Path(self.sheet.file).name)
            shutil.move(Path(folder, "picture").with_suffix(path.suffix), temporary)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return f"<Inspected {Path(self.sheet.file).name}: {len(self.sheet.findings)} findings>"

    def _repr_html_(self) -> str:
        from lumbar.publishing.pages.html import listing

        return str(listing(self.lines()))
