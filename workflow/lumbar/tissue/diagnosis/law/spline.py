"""A missing force as splines over the position, or over position and velocity, where no short formula was found.

In position cubic B-splines on even knots (de Boor, A Practical Guide to Splines, 1978), in velocity straight pieces between
knots. What a base's spring and the sensor's zero can take up, a straight line over the position, is left to them. Beyond the
knots the surface is held as it ends there.
"""

import numpy as np

from lumbar.tissue.diagnosis.fitting.joint_fit import fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.law.search import Law
from lumbar.tissue.diagnosis.law.terms import Term
from lumbar.tissue.diagnosis.law.validation import motions
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.parameter import Constant, LinearParameter

NAME = "smooth_surface"
LABEL = "smooth surface, no mechanism"
_PIECES = ((6, 0), (10, 0), (16, 0), (22, 0), (31, 0), (6, 2), (10, 2))
"""Intervals along the position, and on either side of rest along the velocity: 0 where that does not count."""
_OUTERMOST = 0.002
"""Share of the samples at either end of position and speed that the surface takes as at the end."""
_FEWEST = 10.0
"""Samples that an amplitude over position and velocity rests on, counted by its spline: where there are fewer none is added."""
_DIGITS = 4
"""Of knots, which stand in the form's file."""


def smooth_surfaces(start: Candidate, experiment: Experiment) -> list[Law]:
    """Fit surfaces of several finenesses beside a model and judge them on all records, the likeliest first."""
    every = motions(experiment.training)
    position, velocity = (
        np.concatenate([getattr(motion, name) for motion in every]) for name in ("position", "velocity")
    )
    found = []
    for along, across in _PIECES:
        form = _form(position, velocity, along, across)
        over = "position and velocity" if across else "position"
        words = (
            f"{LABEL}: {len(form.linear)} amplitudes of splines over {over}, held constant beyond the data"
        )
        structure = start.fit.structure.with_form(form)
        fitted = fit(structure, experiment.training, start.fit.nonlinear)
        found.append(Law(start, (Term(NAME, words, ()),), evaluate(fitted, experiment)))
    return sorted(found, key=lambda law: law.candidate.score)


def _form(position: np.ndarray, velocity: np.ndarray, along: int, across: int) -> Form:
    """Splines with `along` intervals of the range of positions, and `across` from rest to the highest speed.

    Of those over the position alone the outermost at both ends are left out, as many as a straight line has constants.
    """
    low, high = np.quantile(position, [_OUTERMOST, 1 - _OUTERMOST])
    z_0, h = _rounded(low), _rounded((high - low) / along)
    steps = f"clip((z - z_0)/h, 0, {along}) - n"
    spline = f"(max(2 - abs({steps}), 0)**3 - 4*max(1 - abs({steps}), 0)**3)/6"
    terms = [f"sum(n, 0, {along}, F_n*{spline})"]
    names = [f"F_{n}" for n in range(along + 1)]
    constants = [Constant("z_0", z_0, "{x}"), Constant("h", h, "{x}")]
    if across:
        w = _rounded(np.quantile(np.abs(velocity), 1 - _OUTERMOST) / across)
        constants.append(Constant("w", w, "{x}/s"))
        rates = np.clip(velocity / w, -across, across)
        away = np.abs(np.clip((position - z_0) / h, 0, along) - np.arange(along + 1)[:, None])
        along_position = (np.maximum(2 - away, 0) ** 3 - 4 * np.maximum(1 - away, 0) ** 3) / 6
        for number in (*range(-across, 0), *range(1, across + 1)):
            counted = np.flatnonzero(along_position @ np.maximum(1 - np.abs(rates - number), 0) >= _FEWEST)
            if len(counted):
                letter = f"{'B' if number < 0 else 'A'}{abs(number)}"  # backwards, ahead
                piece = f"max(1 - abs(clip(v/w, -{across}, {across}) {'+' if number < 0 else '-'} {abs(number)}), 0)"
                first, last = counted[[0, -1]]
                terms.append(f"{piece}*sum(n, {first}, {last}, {letter}_n*{spline})")
                names += [f"{letter}_{n}" for n in range(first, last + 1)]
    return Form(
        name=f"equation_{along}_{across}",  # motions remember forces by name
        equation=" + ".join(terms),
        place=Place.PARALLEL,
        linear=tuple(LinearParameter(f"force_{name.lower()}", "{y}", 0, symbol=name) for name in names),
        constants=tuple(constants),
        effect=NAME,
    )


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
