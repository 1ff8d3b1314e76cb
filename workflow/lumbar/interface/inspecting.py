"""``lumbar.inspect``: report on a marker file: content, faults, and the result of the pipeline."""

import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.files import replacing
from lumbar.interface.lift import Lift, lift
from lumbar.interface.new_study import recognise_settings
from lumbar.interface.reading import read
from lumbar.lifting.movement.lift_analysis import analyse_lift
from lumbar.lifting.movement.rigid_filling import BodyFilling
from lumbar.lifting.quality.gate import mask_findings
from lumbar.lifting.quality.marker_sets import landmarks
from lumbar.lifting.quality.screening import (
    QualitySheet,
    Screening,
    meant_labels,
    naming,
    quality_sheet,
    sheet_of,
)
from lumbar.records.marker_axes import find_axes, rotation_to_standard
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.records.unpacking import ending_of
from lumbar.settings.lifting import ALIASES, REFINING, LiftingSettings, SubjectSettings, TrialSettings

_PLACEHOLDER_SUBJECT = SubjectSettings(
    name="unknown", sex="unknown", mass_kg=70.0, height_m=1.7, experience="unknown", trials=()
)
"""Any subject for the pipeline, because events and gaps of a recording do not depend on the subject."""
_LANDMARKS = tuple(name for name in ALIASES if not name.startswith("BOX_") and name not in REFINING)
_MEAN = "mean of"
"""Beginning of a rule that uses only markers of the landmark."""


def inspect(
    path: str | os.PathLike,
    *,
    settings: LiftingSettings | None = None,
    height_m: float | None = None,
) -> "InspectionReport":
    """Report on a marker file without computing results from it.

    Parameters
    ----------
    path : path
        C3D, TRC, CSV or BVH file with markers, also packed (``.gz``).
    settings : LiftingSettings, optional
        Rules for reading markers and filling gaps, and the axes; without settings the axes are found from the body in the file.
    height_m : float, optional
        Stature of the subject, for the check of body lengths.

    Raises
    ------
    InputError
        If the file cannot be read, or is a record of force and position.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_lift
    >>> subject = example_lift("lift.c3d")
    >>> report = lumbar.inspect("lift.c3d", height_m=subject.height_m)
    >>> report.sheet.findings
    ()
    >>> print(report.axes)
    up +z, forward +y (7 pairs of left and right markers, 9 of front and back)
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the files in it, e.g. {path}/*.c3d")
    try:
        chosen = settings or recognise_settings(path, height_m)
        file = _read(path, chosen, height_m)
    except InputError as error:
        _reject_record(path, error)
        raise
    layout = chosen.markers
    # The axes of the body, from the markers that are not left out, after the inverse of the settings' rotation.
    masked = mask_findings(file.screening.points, file.screening.findings)
    usable = {label: places for label, places in masked.items() if np.isfinite(places).any()}
    named = {label: name for name, label in landmarks(usable, meant_labels(layout.aliases, usable)).items()}
    rotation = rotation_to_standard(layout.up, layout.forward)
    body_axes = find_axes({name: usable[label] @ rotation for label, name in named.items()})
    up, forward, axes = layout.up, layout.forward, str(body_axes or "not known from the labels")
    if body_axes and (body_axes.forward or body_axes.up[1] != forward[1]):
        up, forward = body_axes.up, body_axes.forward or forward
    if not (body_axes and body_axes.forward):
        axes += f"; up {up} and forward {forward} are assumed"
    is_rotated = (up, forward) != (layout.up, layout.forward)
    pipeline = _run_pipeline(path, file, chosen)
    if is_rotated:
        axes += f", but up {layout.up} and forward {layout.forward} in the settings"
        turned = layout.model_copy(update={"up": up, "forward": forward})
        file = _read(path, chosen.model_copy(update={"markers": turned}), height_m)
    recording, screening = file.recording, file.screening
    return InspectionReport(
        sheet=quality_sheet(recording, screening.points, screening.findings, screening.unchecked),
        axes=axes,
        pipeline=pipeline,
        points=screening.points,
        time=recording.time,
        meant=meant_labels(layout.aliases, screening.points),
        prefixes=recording.subjects,
        recognised=tuple(
            name
            for name in _LANDMARKS
            if name in recording.positions and recording.derived.get(name, _MEAN).startswith(_MEAN)
        ),
        has_settings=settings is not None,
    )


@dataclass(frozen=True)
class _MarkerFile:
    """A marker file that is read a single time, for the report and for the pipeline."""

    recording: MarkerRecording
    screening: Screening
    bodies: BodyFilling


def _read(path: Path, settings: LiftingSettings, height_m: float | None) -> _MarkerFile:
    screening, bodies = Screening(height_m, settings.markers.aliases, refuse=False), BodyFilling(settings)
    layout = settings.markers.model_copy(update={"required": (), "check_axes": False})
    recording = read_markers(path, layout, screen=screening, repair=bodies)
    if set(screening.points) == {"position"}:  # the columns position_x_mm, … of a record
        _reject_record(path)
    return _MarkerFile(recording, screening, bodies)


def _reject_record(path: Path, cause: InputError | None = None) -> None:
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


def _run_pipeline(path: Path, file: _MarkerFile, settings: LiftingSettings) -> tuple[bool, str]:
    """Return whether a lift is analysed with these settings, and its events or the reason why not."""
    recording, screening, bodies = file.recording, file.screening, file.bodies
    layout, trial = settings.markers, TrialSettings(box_mass_kg=0.0, markers=path.name)
    subject = _PLACEHOLDER_SUBJECT.model_copy(
        update={"height_m": screening.height_m or _PLACEHOLDER_SUBJECT.height_m}
    )
    try:
        if layout.required != ():
            return True, str(lift(path, subject, 0.0, settings=settings))
        with naming(path):
            screening.raise_errors()
            sheet = sheet_of(recording, screening, layout)
        sheet = replace(sheet, findings=(*sheet.findings, *bodies.findings))
        analysed = analyse_lift(recording, subject, trial, settings, bodies.gaps, sheet.findings)
        return True, str(Lift(analysed, subject, trial, settings, "", sheet))
    except (InputError, NumericalError) as error:
        return False, str(error)


def check_picture_format(path: Path) -> None:
    """Raise for a picture in a format that is not written.

    Parameters
    ----------
    path : Path
        The picture.

    Raises
    ------
    InputError
        If the ending of the file is not ``.svg`` or ``.pdf``.
    """
    if path.suffix not in (".svg", ".pdf"):
        raise InputError(f"{path}: pictures are written as .svg or .pdf")


@dataclass(frozen=True, eq=False, repr=False)
class InspectionReport:
    """Report on a marker file."""

    sheet: QualitySheet
    """Quality report: content of the file, faults, and use of markers."""
    axes: str
    """Axes that point up and forward."""
    pipeline: tuple[bool, str]
    """Whether the pipeline can analyse the file as a lift, and the detected events or the reason why not."""
    points: dict[str, np.ndarray]
    """Measured markers by the file's labels, shape (n_frames, 3): metres, x to the right, y forward, z up."""
    time: np.ndarray
    """Time of the frames in seconds, shape (n_frames,)."""
    meant: dict[str, str]
    """Label by standard name, for names that a single label gives."""
    prefixes: tuple[str, ...]
    """Prefixes of subjects, removed from the labels."""
    recognised: tuple[str, ...]
    """Landmarks that one marker, or the mean of several, gives."""
    has_settings: bool
    """True if the settings name the labels."""

    def to_dict(self) -> dict:
        """Return all but the trajectories as data for JSON."""
        is_analysed, outcome = self.pipeline
        return {
            "schema": "lumbar.inspected/1",
            **self.sheet.to_dict(),
            "prefixes": list(self.prefixes),
            "axes": self.axes,
            "filled": dict(self.meant),
            "recognised": list(self.recognised),
            "analysed": is_analysed,
            "pipeline": outcome,
        }

    def lines(self, details: bool = False) -> list[str]:
        """Return all but the trajectories as text.

        Parameters
        ----------
        details : bool, default False
            True lists each finding, each label and all reasons; False counts them.
        """
        sheet, (is_analysed, outcome) = self.sheet, self.pipeline
        filled = [name if name == label else f"{name} = {label}" for name, label in self.meant.items()]
        guessed = {
            name: rule
            for name, rule in sheet.estimated.items()
            if name in _LANDMARKS and name not in self.recognised
        }
        missing = [name for name in _LANDMARKS if name not in (*guessed, *self.recognised)]
        lists = {
            "subjects' prefixes removed": ", ".join(self.prefixes),
            "axes": self.axes,
            "markers": ", ".join(filled) if details else "",
            "estimated": "; ".join(f"{name} ({rule})" for name, rule in guessed.items()),
            "not recognised": ", ".join(missing) if self.recognised else "",
            "other markers": ", ".join(sheet.unused) if details else f"{len(sheet.unused) or ''}",
        }
        lines = [*sheet.lines(details), *(f"{subject}: {text}" for subject, text in lists.items() if text)]
        first, *reasons = outcome.replace(f"{sheet.file}: ", "").replace(f"{sheet.file}, ", "").splitlines()
        if reasons and not (details or (is_analysed and not first.startswith("lift_off: none"))):
            first, reasons = first + ("" if is_analysed else ", see --details"), []
        lines.append(f"as a lift: {'' if is_analysed else 'rejected: '}{first}")
        return [*lines, *(f"  {line}" for line in reasons), self._next_step()]

    def _next_step(self) -> str:
        """Return the number of recognised landmarks and what remains to do."""
        remaining = "run `lumbar new-study FOLDER`"
        if self.has_settings:
            free = [name for name in landmarks(self.sheet.unused) if name in self.sheet.absent]
            remaining = (
                f"name the labels of {', '.join(free)} in markers.aliases" if free else "run `lumbar lift`"
            )
        elif not self.recognised:
            remaining += ", then name the labels in its aliases"
        return f"{len(self.recognised)} of {len(_LANDMARKS)} landmarks recognised; {remaining}"

    def save_picture(self, path: str | os.PathLike) -> None:
        """Draw heights, gaps and findings into a file.

        Parameters
        ----------
        path : path
            The file, ``.svg`` or ``.pdf``.
        """
        from lumbar.publishing.figures.movement_figures import quality_figure
        from lumbar.publishing.figures.style import save

        path = Path(path)
        check_picture_format(path)
        figure = quality_figure(self.sheet, self.points, self.time, self.meant)
        with TemporaryDirectory() as folder, replacing(path) as temporary:
            save(figure, Path(folder, "picture"), Path(self.sheet.file).name)
            shutil.move(Path(folder, "picture").with_suffix(path.suffix), temporary)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return f"<InspectionReport {Path(self.sheet.file).name}: {len(self.sheet.findings)} findings>"

    def _repr_html_(self) -> str:
        from lumbar.publishing.pages.html import listing

        return str(listing(self.lines()))
