"""What a joint adds to the pendulum of Eq. 4.1: passive stiffness, dry friction, drag.

The input is the angle from the vertical, the output the moment that the person exerts at the pivot.
"""

from __future__ import annotations

from dataclasses import replace

from lumbar.tissue.effects import damping_and_inertia, friction
from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.parameter import LinearParameter, NonlinearParameter

_AT_ZERO = LinearParameter("moment_at_zero", "{y}", sign=0, symbol="M0")

PASSIVE_STIFFNESS = Effect(
    name="passive_stiffness",
    mechanism="Muscles, ligaments and capsule resist the angle: a moment that grows towards the end of the range.",
    source="Riener and Edrich, J. Biomech. 32 (1999) 539-544; Anderson, Madigan and Nussbaum, J. Biomech. 40 (2007) 3105-3113",
    experiment="move slowly to both ends of the range: the moment beyond gravity's grows with the angle alone",
    forms=(
        Form(
            name="linear",
            equation="k*theta + M0",
            place=Place.PARALLEL,
            linear=(LinearParameter("rotational_stiffness", "{y}/{x}", symbol="k"), _AT_ZERO),
        ),
        Form(
            name="cubic",
            equation="k3*theta**3",
            place=Place.PARALLEL,
            linear=(LinearParameter("cubic_stiffness", "{y}/{x}^3", symbol="k3"),),
        ),
        Form(
            name="exponential",
            equation="M_p*expm1(theta/theta_e) - M_m*expm1(-theta/theta_e) + M0",
            place=Place.PARALLEL,
            linear=(
                LinearParameter("stiffening_ahead", "{y}", symbol="M_p", latex="M_+"),
                LinearParameter("stiffening_behind", "{y}", symbol="M_m", latex="M_-"),
                _AT_ZERO,
            ),
            nonlinear=(
                NonlinearParameter(
                    "stiffening_angle", "{x}", "position", 0.1, 1.0, 6, reach=(0.5, 4.0), symbol="theta_e"
                ),
            ),
        ),
    ),
)


def _about_the_pivot(form: Form) -> Form:
    """The same form with linear parameters called moments."""
    renamed = (
        replace(item, name=item.name.replace("force", "moment"), symbol=item.symbol.replace("F", "M"))
        for item in form.linear
    )
    return replace(form, linear=tuple(renamed), equation=form.equation.replace("F", "M"))


COULOMB_FRICTION = replace(
    friction.COULOMB,
    mechanism="Dry friction in the joint: a moment against the motion that does not depend on its speed.",
    experiment="move slowly to and fro: the moment jumps at every reversal, by as much at any speed",
    forms=tuple(map(_about_the_pivot, friction.COULOMB.forms)),
)

DRAG = Effect(
    name="drag",
    mechanism="Resistance of the air or water: a moment that grows with the square of the speed.",
    source=damping_and_inertia.QUADRATIC_DAMPING.source,
    experiment="swing at one frequency with growing amplitude: the moment in phase with speed grows with its square",
    forms=tuple(
        _about_the_pivot(form)
        for form in damping_and_inertia.QUADRATIC_DAMPING.forms
        if form.name in ("quadratic", "power")
    ),
)

EFFECTS = (PASSIVE_STIFFNESS, COULOMB_FRICTION, DRAG)
