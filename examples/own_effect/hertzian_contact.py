"""An effect of your own in one file: a round tool tip that sinks into the tissue (Hertz).

Named in a study under ``improvement: effect_files:``, it is fitted, diagnosed and reported as those of the catalogue
are, and exported in FMUs: simulation, LaTeX and C code follow from the equation. hertzian_contact.yaml is the same without
Python.
"""

from lumbar.tissue.models.form import Effect, Form, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.parameter import Constant

HERTZIAN_CONTACT = Effect(
    name="hertzian_contact",
    mechanism="The contact area of a round tip grows with its depth, and with it the stiffness.",
    source="Johnson, Contact Mechanics (1985), section 4.2",
    experiment="push to several depths with two tips of different radius: the force grows with the root of the radius",
    forms=(
        Form(
            name="sphere",
            equation="k_H*max(z, 0)**1.5",
            place=Place.PARALLEL,
            linear=(LinearParameter("contact_stiffness", "{y}/{x}^1.5", symbol="k_H"),),
        ),
        Form(
            name="power",
            equation="Fn*max(z/z_1, 0)**n",
            place=Place.PARALLEL,
            linear=(LinearParameter("contact_force", "{y}", symbol="Fn"),),
            nonlinear=(
                NonlinearParameter("exponent", "1", "one", 1.2, 3.0, 4, reach=(0.9, 1.3), symbol="n"),
            ),
            constants=(Constant("z_1", 1.0, "{x}"),),
        ),
    ),
)
