"""A tool that is not fastened to the tissue: it presses where it touches, and never pulls."""

from __future__ import annotations

import numpy as np

from lumbar.models.c_step import CStep
from lumbar.models.form import Form, HandWritten, Place

TOUCH = Form(
    name="touch",
    equation=r"z \to \max(z, 0)",
    place=Place.INPUT,
    hand_written=HandWritten(
        input_transform=lambda motion, nonlinear: motion.replaced(np.maximum(motion.position, 0.0)),
        c_step=CStep("position > 0 ? position : 0"),
    ),
    effect="contact",
)
"""The tissue is moved by what the tool is below its surface; positions count from there."""

LIFT_OFF = Form(name="lift_off", equation="max(F, 0)", place=Place.OUTPUT, effect="contact")
"""A tissue that comes back more slowly than the tool leaves it."""
