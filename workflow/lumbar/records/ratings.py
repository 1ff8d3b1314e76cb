"""Answers of a survey: one row per participant, with the columns of `lumbar.settings.runtime.RatingsLayout`, all checked."""

import json
import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import require_file
from lumbar.records.number_table import Dialect, split_rows, stream_lines
from lumbar.settings.runtime import MAX_SCALE_POINTS, RatingsLayout

NOT_REAL = "reconstructed_not_real"
"""Value of the source column of reconstructed answers."""
_YES = ("1", "yes", "true")
_NO = ("0", "no", "false")
_EMPTY = ("", "na", "n/a", "nan", "-", ".")
"""Cells that spreadsheets and statistics programs write for a missing answer, in lower case."""
_DELIMITERS = (";", "\t", ",", "|")


@dataclass(frozen=True)
class Ratings:
    """Answers of all participants."""

    participants: tuple[str, ...]
    """Names or codes in the order of the file."""
    models: tuple[str, ...]
    """Rated models, in the order of the tables."""
    scores: np.ndarray
    """Ratings from 1 to `scale_points`, shape (participants, models)."""
    scale_points: int
    """Number of points of the Likert scale."""
    best: tuple[str, ...]
    """Model that each participant chose as the best."""
    groups: dict[str, np.ndarray]
    """Answers by yes/no question, shape (participants,)."""
    experience: tuple[str, ...] = ()
    """Experience level of each participant; empty if the survey did not ask for it."""
    experience_levels: tuple[str, ...] = ()
    """All possible experience levels in order."""
    sources: tuple[str, ...] = ()
    """Distinct values of the source column, sorted; empty without the column."""

    def __len__(self) -> int:
        return len(self.participants)

    def scores_of(self, model: str) -> np.ndarray:
        """Return all ratings of one model, shape (participants,).

        Parameters
        ----------
        model : str
            Rated model, one of `models`.
        """
        return self.scores[:, self.models.index(model)]

    def counts(self) -> np.ndarray:
        """Return the number of each rating, shape (models, scale_points)."""
        points = np.arange(1, self.scale_points + 1)
        return (self.scores.T[:, :, None] == points).sum(axis=1)

    def picks(self) -> np.ndarray:
        """Return how often each model was chosen as the best, shape (models,)."""
        return np.array([self.best.count(model) for model in self.models])

    def label(self, source_label: str, not_real: str) -> str:
        """Return the source label of tables and figures.

        Parameters
        ----------
        source_label : str
            Label of the study.
        not_real : str
            Text before the label if some answers are reconstructed.
        """
        return f"{not_real}, {source_label}" if NOT_REAL in self.sources else source_label


def read_ratings(path: str | os.PathLike, layout: RatingsLayout) -> Ratings:
    """Read a table of the participants' answers.

    Parameters
    ----------
    path : path
        The file.
    layout : RatingsLayout
        Columns, models and scale.

    Raises
    ------
    InputError
        If there are problems, with line and column of each: a missing column, empty cells, a rating outside the scale,
        an unknown model or level, a participant in two lines, a line of another length, fewer than two participants.
    """
    path = Path(path)
    optional = filter(None, (layout.experience, layout.source))
    models = [model.column for model in layout.models]
    columns = [layout.participant, *models, layout.best, *layout.yes_no, *optional]
    _check_layout(layout, columns)
    require_file(path)
    dialect = Dialect(layout.delimiter, quotes_span_lines=True)
    rows = [row for row in split_rows(stream_lines(path), dialect, str(path)) if any(row.cells)]
    if not rows:
        raise InputError(f"{path}: empty; a header with {', '.join(columns)} is needed")
    header = rows[0].cells
    if shared := _duplicates(header):
        raise InputError(f"{path}, header: duplicate {', '.join(map(repr, shared))}; rename these columns")
    problems, absent = Problems(str(path)), [column for column in columns if column not in header]
    text = layout.delimiter.join(header)
    other = next((mark for mark in _DELIMITERS if absent and set(columns) <= set(text.split(mark))), None)
    if other:
        allowed = f"set survey.layout.delimiter: {json.dumps(other)}"
        problems.add("header", f"{other!r} separates the cells, not {layout.delimiter!r}", allowed)
        problems.raise_if_any()
    for column in absent:
        problems.add("header", f"no column {column!r}", f"there are: {', '.join(header)}")
    answers = {}
    for line, cells in rows[1:]:
        if len(cells) == len(header):
            answers[line] = dict(zip(header, cells, strict=True))
        else:
            problems.add(f"line {line}", f"{len(cells)} cells", f"the header has {len(header)}")
    _validate(answers, [column for column in columns if column in header], layout, problems)
    problems.raise_if_any()
    if len(answers) < 2:
        raise InputError(f"{path}: {len(answers)} participants; statistics need at least 2")
    return _ratings(list(answers.values()), layout)


def _duplicates(names: Iterable[str]) -> list[str]:
    return sorted(name for name, count in Counter(names).items() if count > 1)


def _check_layout(layout: RatingsLayout, columns: list[str]) -> None:
    """Raise if the layout contradicts itself."""
    problems = Problems("survey.layout")
    for name in _duplicates(model.name for model in layout.models):
        problems.add("models", f"duplicate {name}", "each model has one column")
    for column in _duplicates(columns):
        problems.add("", f"column {column!r} is used twice", "each answer has its own column")
    if layout.experience and not layout.experience_levels:
        problems.add("experience_levels", "missing", "list the levels that could be chosen")
    problems.raise_if_any()


def _validate(
    answers: dict[int, dict[str, str]], columns: list[str], layout: RatingsLayout, problems: Problems
) -> None:
    """Add every cell that is wrong to `problems`; cells with one remedy are one problem."""
    rated = [model.column for model in layout.models if model.column in columns]
    points = tuple(str(point) for point in range(1, layout.scale_points + 1))
    allowed = dict.fromkeys(rated, points) | {layout.best: tuple(model.name for model in layout.models)}
    allowed |= dict.fromkeys(layout.yes_no, (*_YES, *_NO))
    if layout.experience:
        allowed[layout.experience] = tuple(layout.experience_levels)
    has_other_scale = _add_other_scale(answers, rated, layout.scale_points, problems)
    participants: set[str] = set()
    empty: dict[int, list[str]] = {}
    for line, cells in answers.items():
        for column in columns:
            cell = cells[column].lower() if column in layout.yes_no else cells[column]
            rating = _number(cell) if column in rated else np.nan
            if cell in allowed.get(column, ()) or rating in range(1, layout.scale_points + 1):
                continue
            if cell.lower() in _EMPTY:
                empty.setdefault(line, []).append(column)
            elif column in allowed and not (has_other_scale and np.isfinite(rating)):
                problems.add(
                    f"line {line}", f"{column} is {cell!r}", f"allowed: {', '.join(allowed[column])}"
                )
            elif column == layout.participant and cell in participants:
                fault = f"{column} is {cell!r}"
                problems.add(f"line {line}", fault, "this participant is also in an earlier line")
        participants.add(cells.get(layout.participant, ""))
    if empty:
        shown = [f"line {line} ({', '.join(names)})" for line, names in empty.items()]
        rest = [f"{len(shown) - 4} more lines"] if len(shown) > 5 else shown[4:]
        remain = len(answers) - len(empty)
        left = f", or take out these rows: {remain} of {len(answers)} remain" if remain > 1 else ""
        problems.add("", f"empty cells in {', '.join([*shown[:4], *rest])}", f"fill them in{left}")


def _number(cell: str) -> float:
    """Return a rating with a decimal point or comma as a number; NaN for any other text."""
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return np.nan


def _add_other_scale(
    answers: dict[int, dict[str, str]], rated: list[str], scale_points: int, problems: Problems
) -> bool:
    """Add a problem, with the remedy, if all ratings are on a scale of half points or on a scale from 0."""
    cells = {(line, column): _number(row[column]) for line, row in answers.items() for column in rated}
    known = np.array([value for value in cells.values() if np.isfinite(value)])
    first, step = 1 - bool((known == 0).any()), 1.0 if (known % 1 == 0).all() else 0.5
    last = max(known.max(initial=0), scale_points - 1 + first)
    if (first, step) == (1, 1.0) or (known % step).any() or known.min() < 0 or last > scale_points:
        return False
    line, column = next(
        place for place, value in cells.items() if (value == 0 if first == 0 else value % 1 == 0.5)
    )
    points = round((last - first) / step) + 1
    change = "add 1 to" if step == 1 else f"double, then {'take 1 from' if first else 'add 1 to'},"
    remedy = f"{change} every rating" if points <= MAX_SCALE_POINTS else "round every rating"
    if scale_points != points <= MAX_SCALE_POINTS:
        remedy += f" and set survey.layout.scale_points: {points} with {points} survey.scale_labels"
    cause = "half points were allowed" if first else "the scale begins at 0 (not: no answer)"
    fault = f"{column} is {cells[line, column]:g}; allowed: whole points from 1"
    problems.add(f"line {line}", fault, f"if {cause}, {remedy}")
    return True


def _ratings(rows: list[dict[str, str]], layout: RatingsLayout) -> Ratings:
    """Return the ratings of valid rows."""
    experience, source = layout.experience, layout.source
    return Ratings(
        participants=tuple(row[layout.participant] for row in rows),
        models=tuple(model.name for model in layout.models),
        scores=np.array([[int(_number(row[model.column])) for model in layout.models] for row in rows]),
        scale_points=layout.scale_points,
        best=tuple(row[layout.best] for row in rows),
        groups={column: np.array([row[column].lower() in _YES for row in rows]) for column in layout.yes_no},
        experience=tuple(row[experience] for row in rows) if experience else (),
        experience_levels=tuple(layout.experience_levels) if experience else (),
        sources=tuple(sorted({row[source] for row in rows})) if source else (),
    )
