"""The models of the thesis, defined once: mechanical analogue, equation, parameters, discrete structure.

Table 2.1, the schematics of Figure 3.2, the identification and the recovery of physical parameters all read
these definitions. A definition holds no data and no fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from lumbar.errors import InputError, NumericalError
from lumbar.models.arx_structure import ArxStructure
from lumbar.models.first_order import FirstOrder, undiscretise
from lumbar.models.network import Dashpot, Network, Parallel, Series, Spring
from lumbar.models.transfer_function import TransferFunction

_UNITS = {"stiffness": "{output}/{input}", "viscosity": "{output}·s/{input}", "time": "s"}


@dataclass(frozen=True)
class Parameter:
    """A physical parameter.

    Attributes
    ----------
    symbol : str
        Key in files, e.g. ``"k1"``.
    latex : str
        As it is printed, e.g. ``"k_1"``.
    definition : str
        What it is.
    kind : str
        ``"stiffness"``, ``"viscosity"`` or ``"time"``; gives the unit.
    """

    symbol: str
    latex: str
    definition: str
    kind: str

    def unit(self, input_unit: str, output_unit: str) -> str:
        """Return the unit for records in these units, e.g. ``"N·s/mm"``."""
        return _UNITS[self.kind].format(input=input_unit, output=output_unit)


@dataclass(frozen=True)
class Model:
    """A tissue model as the thesis names it.

    Attributes
    ----------
    name, title : str
        Short and full name.
    equation, latex : str
        Governing equation in plain text and in LaTeX.
    parameters : tuple of Parameter
        Physical parameters; empty for a model that has none.
    relations : tuple of str
        How the equation's coefficients follow from the mechanical elements.
    network : Network or None
        Mechanical analogue; None for a black box.
    structure : ArxStructure or None
        Free coefficients of the discrete transfer function; None where the structure is searched for (HO),
        fixed without a fit (IL) or improper (KV).
    transfer : str
        The discrete transfer function in plain text.
    elements : callable or None
        From a stable transfer function and the sampling time to physical parameters; raises `NumericalError`
        where they do not exist.
    no_parameters_because : str
        Why no physical parameters are recovered, where `elements` is None.
    """

    name: str
    title: str
    equation: str
    latex: str
    transfer: str
    parameters: tuple[Parameter, ...] = ()
    relations: tuple[str, ...] = ()
    network: Network | None = None
    structure: ArxStructure | None = None
    elements: Callable[[TransferFunction, float], dict[str, float]] | None = field(default=None, repr=False)
    no_parameters_because: str = ""

    def physical_parameters(
        self, transfer_function: TransferFunction, sampling_time: float
    ) -> dict[str, float]:
        """Physical parameters of an identified model (ramp-invariant conversion, exact).

        Raises
        ------
        NumericalError
            With the reason, where the transfer function has no mechanical counterpart.
        """
        if self.elements is None:
            raise NumericalError(f"{self.name}: {self.no_parameters_because}")
        return self.elements(transfer_function, sampling_time)


def maxwell(k: float, b: float) -> FirstOrder:
    """Spring k and dashpot b in series: F + αḞ = b ẋ with α = b/k (Table 2.1)."""
    return FirstOrder(k=0.0, nu=b, gamma=b / k)


def kelvin_boltzmann(k1: float, k2: float, b: float) -> FirstOrder:
    """Spring k1 parallel to dashpot b, both in series with spring k2 (Table 2.1)."""
    total = k1 + k2
    return FirstOrder(k=k1 * k2 / total, nu=b * k2 / total, gamma=b / total)


def _linear_elastic_elements(transfer_function: TransferFunction, _: float) -> dict[str, float]:
    (stiffness,) = transfer_function.numerator
    if stiffness <= 0:
        raise NumericalError(f"LE: the stiffness is {stiffness:.4g}, a spring has k > 0")
    return {"k": stiffness}


def _maxwell_elements(transfer_function: TransferFunction, sampling_time: float) -> dict[str, float]:
    system = undiscretise(transfer_function, sampling_time)
    if system.nu <= 0:
        raise NumericalError(f"Maxwell: the viscosity is {system.nu:.4g}, a dashpot has b > 0")
    return {"k": system.nu / system.gamma, "b": system.nu, "alpha": system.gamma}


def _kelvin_boltzmann_elements(transfer_function: TransferFunction, sampling_time: float) -> dict[str, float]:
    system = undiscretise(transfer_function, sampling_time)
    k2 = system.nu / system.gamma  # stiffness against fast motion: the dashpot is locked
    if not 0 < system.k < k2:
        raise NumericalError(
            f"KB: stiffness {system.k:.4g} at rest and {k2:.4g} for fast motion; springs k1, k2 > 0 need "
            "0 < rest < fast"
        )
    k1 = system.k * k2 / (k2 - system.k)
    return {
        "k": system.k,
        "nu": system.nu,
        "gamma": system.gamma,
        "k1": k1,
        "k2": k2,
        "b": system.gamma * (k1 + k2),
    }


_K = Parameter("k", "k", "stiffness", "stiffness")
_B = Parameter("b", "b", "viscosity of the dashpot", "viscosity")

LE = Model(
    name="LE",
    title="Linear elastic",
    equation="f(t) = k x(t)",
    latex=r"f_e(t) = k\,x(t)",
    transfer="b0",
    parameters=(_K,),
    network=Spring("k"),
    structure=ArxStructure(order=0, input_lags=(0,)),
    elements=_linear_elastic_elements,
)
MAXWELL = Model(
    name="Maxwell",
    title="Maxwell",
    equation="f(t) = b x'(t) − α f'(t)",
    latex=r"f_e(t) = b\,\dot{x}(t) - \alpha\,\dot{f}_e(t)",
    transfer="b (z − 1)/(z − a)",
    parameters=(_K, _B, Parameter("alpha", r"\alpha", "relaxation time", "time")),
    relations=("α = b/k",),
    network=Series((Spring("k"), Dashpot("b"))),
    structure=ArxStructure(order=1, input_lags=(0, 1), zero_static_gain=True),
    elements=_maxwell_elements,
)
KV = Model(
    name="KV",
    title="Kelvin–Voigt",
    equation="f(t) = k x(t) + b x'(t)",
    latex=r"f_e(t) = k\,x(t) + b\,\dot{x}(t)",
    transfer="b1 z − b0 (eq. 3.5, improper)",
    parameters=(_K, _B),
    network=Parallel((Spring("k"), Dashpot("b"))),
    no_parameters_because="its transfer function b1 z − b0 (Eq. 3.5) is improper: it is not identified",
)
"""Eq. 3.5: improper, not identified."""
KB = Model(
    name="KB",
    title="Kelvin–Boltzmann",
    equation="f(t) = k x(t) + ν x'(t) − γ f'(t)",
    latex=r"f_e(t) = k\,x(t) + \nu\,\dot{x}(t) - \gamma\,\dot{f}_e(t)",
    transfer="(b1 z − b0)/(z − a0) (eq. 3.4)",
    parameters=(
        Parameter("k", "k", "stiffness at rest", "stiffness"),
        Parameter("nu", r"\nu", "viscosity", "viscosity"),
        Parameter("gamma", r"\gamma", "relaxation time", "time"),
        Parameter("k1", "k_1", "stiffness parallel to the dashpot", "stiffness"),
        Parameter("k2", "k_2", "stiffness in series, felt by fast motion", "stiffness"),
        _B,
    ),
    relations=("k = k1 k2/(k1 + k2)", "ν = b k2/(k1 + k2)", "γ = b/(k1 + k2)"),
    network=Series((Parallel((Spring("k1"), Dashpot("b"))), Spring("k2"))),
    structure=ArxStructure(order=1, input_lags=(0, 1)),
    elements=_kelvin_boltzmann_elements,
)
"""Eq. 3.4."""
MW = Model(
    name="MW",
    title="Maxwell, Eq. 3.3",
    equation="f[k] = a0 f[k−1] + b0 x[k−1]",
    latex=r"H(z) = \frac{b_0}{z - a_0}",
    transfer="b0/(z − a0) (eq. 3.3)",
    network=MAXWELL.network,
    structure=ArxStructure(order=1, input_lags=(1,)),
    no_parameters_because=(
        "Eq. 3.3 has a static force, a spring and dashpot in series has none: "
        "k and b are recovered from Maxwell only"
    ),
)
"""Eq. 3.3, as published: no spring and dashpot in series, which is `MAXWELL`."""
HO = Model(
    name="HO",
    title="Higher order",
    equation="f[k] = Σ b x[k−j] − Σ a f[k−i]",
    latex=r"H(z) = \frac{b_m + \cdots + b_0 z^{-m}}{1 + a_{n-1} z^{-1} + \cdots + a_0 z^{-n}}",
    transfer="eq. 3.9, n ≥ 2, proper or biproper",
    no_parameters_because="a black box has no mechanical elements",
)
"""Eq. 3.9."""
IL = Model(
    name="IL",
    title="Inverted linear",
    equation="f(t) = −(f_max/x_max) x(t)",
    latex=r"f_e(t) = -\frac{f_{\max}}{x_{\max}}\,x(t)",
    transfer="−f_max/x_max, not identified",
    network=Spring("k"),
    no_parameters_because="its slope is set by the device's largest force, not identified",
)

MODELS = {model.name: model for model in (LE, MAXWELL, KV, KB, MW, HO, IL)}
"""Every model by its short name."""
TABLE_2_1 = (LE, MAXWELL, KV, KB)
"""The viscoelastic models of Table 2.1, in its order."""
FIXED_STRUCTURE = (LE, MW, MAXWELL, KB)
"""Models whose structure is given: only coefficients are identified."""


def inverted_linear(force_max: float, travel: float) -> TransferFunction:
    """Return the IL model: 0 at contact, `force_max` after `travel`, against the other models' direction.

    Raises
    ------
    InputError
        If either is not positive.
    """
    if force_max <= 0 or travel <= 0:
        raise InputError(
            f"tissue.inverted_linear: force_max {force_max:g}, travel {travel:g}; both must be > 0"
        )
    return TransferFunction((-force_max / travel,))


def higher_order_structures(order_max: int) -> list[ArxStructure]:
    """Structures of Eq. 3.9 that the search for HO goes through.

    Orders n = 2 … `order_max`, numerators up to z⁻ⁿ; biproper (current position enters) and strictly proper.
    """
    structures = []
    for order in range(2, order_max + 1):
        for last in range(order + 1):
            structures.append(ArxStructure(order, tuple(range(last + 1))))
        for last in range(1, order + 1):
            structures.append(ArxStructure(order, tuple(range(1, last + 1))))
    return structures
