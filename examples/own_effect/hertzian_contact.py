"""An effect of your own in one file: a round tool tip that sinks into the tissue (Hertz).

Named in a study under ``improvement: effect_files:``, it is fitted, diagnosed and reported as those of the catalogue
are, and exported in FMUs. Equation, simulation and C code stand side by side; the check of the FMUs holds the C code to
the simulation.
"""

import numpy as np

from lumbar.models.c_step import CStep
from lumbar.models.form import Effect, Form, LinearParameter, NonlinearParameter, Place

HERTZIAN_CONTACT = Effect(
    name="hertzian_contact",
    mechanism="The contact area of a round tip grows with its depth, and with it the stiffness.",
    source="Johnson, Contact Mechanics (1985), section 4.2",
    experiment="push to several depths with two tips of different radius: the force grows with the root of the radius",
    forms=(
        Form(
            name="sphere",
            equation=r"k_H \max(z, 0)^{3/2}",
            place=Place.PARALLEL,
            linear=(LinearParameter("contact_stiffness", "{y}/{x}^1.5"),),
            columns=lambda motion, _: [np.maximum(motion.position, 0.0) ** 1.5],
            c_step=CStep(
                "contact_stiffness * (depth * sqrt(depth))",
                "double depth = position > 0 ? position : 0.0;",
            ),
        ),
        Form(
            name="power",
            equation=r"F_n \max(z/z_0, 0)^n,\quad z_0 = 1\ \mathrm{unit}",
            place=Place.PARALLEL,
            linear=(LinearParameter("contact_force", "{y}"),),
            nonlinear=(NonlinearParameter("exponent", "1", "one", 1.2, 3.0, 4, reach=(0.9, 1.3)),),
            columns=lambda motion, nonlinear: [np.maximum(motion.position, 0.0) ** nonlinear[0]],
            c_step=CStep("contact_force * portable_power(position > 0 ? position : 0.0, exponent)"),
        ),
    ),
)
