"""Effects of stiffness and relaxation: hardening, asymmetry, softening, a second Maxwell branch."""

from __future__ import annotations

import numpy as np

from lumbar.models.c_step import RELAX, CStep, ramp_relaxation
from lumbar.models.form import Effect, Form, LinearParameter, NonlinearParameter, Place
from lumbar.models.operators import relaxation

_KNEE = NonlinearParameter("knee", "{x}", "position", 0.1, 0.8, 5, reach=(0.2, 1.2))

HARDENING = Effect(
    name="hardening_stiffness",
    mechanism="The tissue gets stiffer with depth, alike in both directions.",
    source="Fung, Biomechanics: Mechanical Properties of Living Tissues (1993), section 7.5",
    experiment="excite with a larger amplitude: the force of a stiffening spring grows with its cube",
    forms=(
        Form(
            name="cubic",
            equation=r"k_3 z^3",
            place=Place.PARALLEL,
            linear=(LinearParameter("cubic_stiffness", "{y}/{x}^3", sign=0),),
            columns=lambda motion, _: [motion.position * motion.position * motion.position],
            c_step=CStep("cubic_stiffness * (position * position * position)"),
        ),
        Form(
            name="exponential",
            equation=r"F_h\,\mathrm{sign}(z)\,(e^{|z|/z_h} - 1)",
            place=Place.PARALLEL,
            linear=(LinearParameter("hardening_force", "{y}"),),
            nonlinear=(
                NonlinearParameter("hardening_length", "{x}", "position", 0.15, 1.5, 6, reach=(0.7, 3.0)),
            ),
            columns=lambda motion, nonlinear: [
                np.sign(motion.position) * np.expm1(np.abs(motion.position) / nonlinear[0]),
            ],
            c_step=CStep(
                "hardening_force * (sign(position) * portable_expm1(fabs(position) / hardening_length))"
            ),
        ),
        Form(
            name="bilinear",
            equation=r"k_b\,\mathrm{sign}(z)\,\max(|z| - z_b, 0)",
            place=Place.PARALLEL,
            linear=(LinearParameter("added_stiffness", "{y}/{x}", sign=0),),
            nonlinear=(_KNEE,),
            columns=lambda motion, nonlinear: [
                np.sign(motion.position) * np.maximum(np.abs(motion.position) - nonlinear[0], 0.0)
            ],
            c_step=CStep(
                "added_stiffness * (sign(position) * (beyond > 0 ? beyond : 0.0))",
                "double beyond = fabs(position) - knee;",
            ),
        ),
        Form(
            name="power",
            equation=r"k_n\,\mathrm{sign}(z)\,|z/z_1|^n,\quad z_1 = \text{1 unit}",
            place=Place.PARALLEL,
            linear=(LinearParameter("hardening_force", "{y}"),),
            nonlinear=(NonlinearParameter("exponent", "1", "one", 2.0, 6.0, 3, reach=(0.8, 1.5)),),
            columns=lambda motion, nonlinear: [
                np.sign(motion.position) * np.abs(motion.position) ** nonlinear[0]
            ],
            c_step=CStep("hardening_force * (sign(position) * portable_power(fabs(position), exponent))"),
        ),
    ),
)

QUADRATIC = Effect(
    name="quadratic_stiffness",
    mechanism="The stiffness differs between pushing and pulling.",
    source="Brown, Rosen and Sinanan, Biomechanical properties of abdominal organs, MICCAI (2003)",
    experiment="move about two different mean depths: an even force changes the apparent stiffness",
    forms=(
        Form(
            name="quadratic",
            equation=r"k_2 z^2",
            place=Place.PARALLEL,
            linear=(LinearParameter("quadratic_stiffness", "{y}/{x}^2", sign=0),),
            columns=lambda motion, _: [motion.position**2],
            c_step=CStep("quadratic_stiffness * (position * position)"),
        ),
        Form(
            name="two_sided",
            equation=r"k_\pm |z|",
            place=Place.PARALLEL,
            linear=(LinearParameter("half_difference_of_stiffness", "{y}/{x}", sign=0),),
            columns=lambda motion, _: [np.abs(motion.position)],
            c_step=CStep("half_difference_of_stiffness * fabs(position)"),
        ),
        Form(
            name="rounded",
            equation=r"k_\pm (\sqrt{z^2 + r^2} - r)",
            place=Place.PARALLEL,
            linear=(LinearParameter("half_difference_of_stiffness", "{y}/{x}", sign=0),),
            nonlinear=(
                NonlinearParameter("corner_radius", "{x}", "position", 0.05, 0.8, 4, reach=(0.2, 3.0)),
            ),
            columns=lambda motion, nonlinear: [np.hypot(motion.position, nonlinear[0]) - nonlinear[0]],
            c_step=CStep(
                "half_difference_of_stiffness"
                " * (sqrt(position * position + corner_radius * corner_radius) - corner_radius)"
            ),
        ),
        Form(
            name="deep",
            equation=r"k_d \max(z - z_d, 0)",
            place=Place.PARALLEL,
            linear=(LinearParameter("added_stiffness", "{y}/{x}", sign=0),),
            nonlinear=(_KNEE,),
            columns=lambda motion, nonlinear: [np.maximum(motion.position - nonlinear[0], 0.0)],
            c_step=CStep("added_stiffness * (position > knee ? position - knee : 0.0)"),
        ),
        Form(
            name="shallow",
            equation=r"k_d \min(z + z_d, 0)",
            place=Place.PARALLEL,
            linear=(LinearParameter("added_stiffness", "{y}/{x}", sign=0),),
            nonlinear=(_KNEE,),
            columns=lambda motion, nonlinear: [np.minimum(motion.position + nonlinear[0], 0.0)],
            c_step=CStep("added_stiffness * (position < -knee ? position + knee : 0.0)"),
        ),
    ),
)


def _worn(motion, share, length):
    """Stiffness lost after the path travelled, as a share between 0 and `share`."""
    return -share * np.expm1(-motion.path / length)


SOFTENING = Effect(
    name="softening",
    mechanism="The tissue softens with the path travelled or with time (preconditioning, damage).",
    source="Mullins, Rubber Chem. Technol. 42 (1969) 339-362; Fung (1993), section 7.5",
    experiment="repeat the same short record several times after another without rest",
    accumulates=True,
    forms=(
        Form(
            name="path",
            equation=r"-k_s z\,(1 - e^{-s/s_0}),\quad s = \int|\dot z|\,dt",
            place=Place.PARALLEL,
            linear=(LinearParameter("stiffness_lost", "{y}/{x}", sign=-1),),
            nonlinear=(NonlinearParameter("path_constant", "{x}", "path", 0.02, 3.0, 6),),
            columns=lambda motion, nonlinear: [-motion.position * np.expm1(-motion.path / nonlinear[0])],
            c_step=CStep("stiffness_lost * (-position * portable_expm1(-path / path_constant))"),
        ),
        Form(
            name="time",
            equation=r"-k_s z\,(1 - e^{-t/T_s})",
            place=Place.PARALLEL,
            linear=(LinearParameter("stiffness_lost", "{y}/{x}", sign=-1),),
            nonlinear=(NonlinearParameter("time_constant", "s", "duration", 0.02, 3.0, 6),),
            columns=lambda motion, nonlinear: [-motion.position * np.expm1(-motion.time / nonlinear[0])],
            c_step=CStep("stiffness_lost * (-position * portable_expm1(-time / time_constant))"),
        ),
        Form(
            name="path_to_floor",
            equation=r"-k_s z \min(s/s_0, 1)",
            place=Place.PARALLEL,
            linear=(LinearParameter("stiffness_lost", "{y}/{x}", sign=-1),),
            nonlinear=(NonlinearParameter("path_constant", "{x}", "path", 0.05, 1.0, 5, reach=(0.2, 1.5)),),
            columns=lambda motion, nonlinear: [motion.position * np.minimum(motion.path / nonlinear[0], 1.0)],
            c_step=CStep(
                "stiffness_lost * (position * (share < 1 ? share : 1.0))",
                "double share = path / path_constant;",
            ),
        ),
        Form(
            name="whole_force",
            equation=r"F \to F\,(1 - a\,(1 - e^{-s/s_0}))",
            place=Place.OUTPUT,
            nonlinear=(
                NonlinearParameter("share_lost", "1", "one", 0.05, 0.6, 3, reach=(0.02, 1.6)),
                NonlinearParameter("path_constant", "{x}", "path", 0.05, 1.0, 3),
            ),
            output_transform=lambda force, motion, nonlinear: (
                force * (1 - _worn(motion, nonlinear[0], nonlinear[1]))
            ),
            c_step=CStep("force * (1.0 + share_lost * portable_expm1(-path / path_constant))"),
        ),
    ),
)

SECOND_RELAXATION = Effect(
    name="second_relaxation",
    mechanism="The tissue relaxes on a second time scale: another Maxwell branch.",
    source="Wiechert (1893); Fung (1993), section 2.11",
    experiment="hold a step for several of the new time constants, or excite well above 1/(2πτ) if it is fast",
    forms=(
        Form(
            name="maxwell_branch",
            equation=r"k_3 q,\quad \dot q = \dot z - q/\tau_2",
            place=Place.PARALLEL,
            linear=(LinearParameter("branch_stiffness", "{y}/{x}"),),
            nonlinear=(
                NonlinearParameter("relaxation_time", "s", "time", 0.008, 20.0, 12, reach=(0.4, 5.0)),
            ),
            columns=lambda motion, nonlinear: [relaxation(motion, nonlinear[0])],
            c_step=CStep("branch_stiffness * next[0]", RELAX, memory=1, constants=ramp_relaxation),
        ),
    ),
)

EFFECTS = (HARDENING, QUADRATIC, SOFTENING, SECOND_RELAXATION)
