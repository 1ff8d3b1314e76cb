"""Models of the thesis: mechanical analogue, equation, elements, discrete structure.

Table 2.1, the schematics of Figure 3.2 and the identification use these definitions. The continuous models are the bases of
`lumbar.tissue.models.bases`; the thesis's elements (k, ν, γ, k1, k2, b) follow from the parameters of the bases. A mechanical
analogue is a network of springs and dashpots: forces add in parallel, displacements in series.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.bases import BASES, Base
from lumbar.tissue.models.parameter import Parameter
from lumbar.tissue.models.transfer_function import ArxStructure, TransferFunction, undiscretise


@dataclass(frozen=True)
class Spring:
    """Force proportional to elongation."""

    symbol: str
    """Symbol of the stiffness, e.g. ``"k1"``."""


@dataclass(frozen=True)
class Dashpot:
    """Force proportional to the rate of elongation."""

    symbol: str
    """Symbol of the viscosity, e.g. ``"b"``."""


@dataclass(frozen=True)
class Series:
    """Parts that carry the same force; their displacements add."""

    parts: tuple[Network, ...]


@dataclass(frozen=True)
class Parallel:
    """Parts that share the same displacement; their forces add."""

    parts: tuple[Network, ...]


Network = Spring | Dashpot | Series | Parallel


def describe_network(network: Network) -> str:
    """Describe a network, e.g. ``"(spring k1 parallel to dashpot b) in series with spring k2"``.

    Parameters
    ----------
    network : Network
        Springs and dashpots in series and in parallel.
    """
    match network:
        case Spring(symbol):
            return f"spring {symbol}"
        case Dashpot(symbol):
            return f"dashpot {symbol}"
        case Series(parts) | Parallel(parts):
            joint = " in series with " if isinstance(network, Series) else " parallel to "
            return joint.join(
                f"({describe_network(part)})"
                if isinstance(part, Series | Parallel)
                else describe_network(part)
                for part in parts
            )


@dataclass(frozen=True)
class Element(Parameter):
    """A derived parameter of the thesis, e.g. ``"k1"``: a combination of a base's parameters."""

    definition: str
    """Meaning of the element."""


@dataclass(frozen=True)
class TissueModel:
    """A tissue model of the thesis."""

    name: str
    """Short name."""
    title: str
    """Full name."""
    equation: str
    """Governing equation in plain text."""
    transfer: str
    """Discrete transfer function in plain text."""
    base: Base | None = None
    """Continuous base with the same parameters; None for a model without parameters."""
    elements: tuple[Element, ...] = ()
    """Derived parameters of the base."""
    relations: tuple[str, ...] = ()
    """Equations for the coefficients in terms of the mechanical elements."""
    network: Network | None = None
    """Mechanical analogue; None for a black box."""
    structure: ArxStructure | None = None
    """Free coefficients of the discrete transfer function; None if searched (HO), fixed (IL) or improper (KV)."""
    derive: Callable[..., dict[str, float]] | None = field(default=None, repr=False)
    """Function from the base's parameters by name to the values of `elements`."""
    references: str = ""
    """Sources: names and years, with the thesis's reference numbers in brackets."""
    no_parameters_because: str = ""
    """Reason if no parameters are recovered from the transfer function."""

    def element_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values of the elements by name.

        Parameters
        ----------
        values : mapping of str to float
            Parameters of the base by name, in consistent units.

        Raises
        ------
        NumericalError
            If a parameter is not positive, so that no spring or dashpot can have it.
        """
        for name, value in values.items():
            if not value > 0:
                raise NumericalError(f"{self.name}: {name} is {value:.4g}; it must be above 0")
        return self.derive(**values) if self.derive else {}

    def physical_parameters(
        self, transfer_function: TransferFunction, sampling_time: float
    ) -> dict[str, float]:
        """Return the parameters of base and elements of an identified model by name, by exact ramp-invariant conversion.

        Units are those of input and output, and seconds.

        Parameters
        ----------
        transfer_function : TransferFunction
            Identified model of this structure.
        sampling_time : float
            Seconds.

        Raises
        ------
        NumericalError
            If the transfer function has no mechanical counterpart. The message gives the reason.
        """
        if self.structure is None or self.base is None:
            raise NumericalError(f"{self.name}: {self.no_parameters_because}")
        # Parameters of the bases LE, Maxwell and KB together.
        system = undiscretise(transfer_function, sampling_time)
        parameters = {"spring_stiffness": system.k}
        if system.gamma:
            branch_stiffness = system.nu / system.gamma - system.k
            parameters |= {"branch_stiffness": branch_stiffness, "relaxation_time": system.gamma}
        values = {item.name: parameters[item.name] for item in (*self.base.linear, *self.base.nonlinear)}
        return {**values, **self.element_values(values)}


def _kelvin_boltzmann_elements(
    spring_stiffness: float, branch_stiffness: float, relaxation_time: float
) -> dict[str, float]:
    """Return the elements of the series form, a network with the same force as the base."""
    k2 = spring_stiffness + branch_stiffness  # stiffness against fast motion: the dashpot is locked
    k1 = spring_stiffness * k2 / branch_stiffness
    return {
        "k": spring_stiffness,
        "nu": relaxation_time * k2,
        "gamma": relaxation_time,
        "k1": k1,
        "k2": k2,
        "b": relaxation_time * (k1 + k2),
    }


_DEFINITIONS = shipped_yaml(Path(__file__).with_suffix(".yaml"))


def _model(name: str, **computed) -> TissueModel:
    """Return a model of ``tissue_models.yaml`` by its name, with the base of that name."""
    fields = _DEFINITIONS["models"][name]
    fields["elements"] = tuple(
        Element(name, unit, meaning, symbol=name) for name, unit, meaning in fields.pop("elements", ())
    )
    fields["relations"] = tuple(fields.pop("relations", ()))
    return TissueModel(name, base=BASES.get(name), **fields, **computed)


LE = _model(
    "LE",
    network=Spring("k"),
    structure=ArxStructure(order=0, input_lags=(0,)),
    derive=lambda spring_stiffness: {"k": spring_stiffness},
)
MAXWELL = _model(
    "Maxwell",
    network=Series((Spring("k"), Dashpot("b"))),
    structure=ArxStructure(order=1, input_lags=(0, 1), zero_static_gain=True),
    derive=lambda branch_stiffness, relaxation_time: {
        "k": branch_stiffness,
        "b": branch_stiffness * relaxation_time,
        "alpha": relaxation_time,
    },
)
KV = _model(
    "KV",
    network=Parallel((Spring("k"), Dashpot("b"))),
    derive=lambda spring_stiffness, viscosity: {"k": spring_stiffness, "b": viscosity},
)
"""Eq. 3.5, b1 z − b0: improper, not identified."""
KB = _model(
    "KB",
    network=Series((Parallel((Spring("k1"), Dashpot("b"))), Spring("k2"))),
    structure=ArxStructure(order=1, input_lags=(0, 1)),
    derive=_kelvin_boltzmann_elements,
)
"""Kelvin–Boltzmann, Eq. 3.4: H(z) = (b1 z − b0)/(z − a0) with free coefficients b1, b0 and a0."""
MW = _model("MW", network=MAXWELL.network, structure=ArxStructure(order=1, input_lags=(1,)))
"""Eq. 3.3 as published: H(z) = b0/(z − a0). A spring and dashpot in series is `MAXWELL`."""
HO = _model("HO")
"""Eq. 3.9: orders and lags are searched, see `higher_order_structures`."""
IL = _model("IL", network=Spring("k"))

MODELS = {model.name: model for model in (LE, MAXWELL, KV, KB, MW, HO, IL)}
"""Every model by its short name."""
REFERENCES: tuple[str, ...] = tuple(_DEFINITIONS["references"])
"""References of the models of Table 2.1, in full, with the numbers of the thesis's list."""
TABLE_2_1 = (LE, MAXWELL, KV, KB)
"""The viscoelastic models of Table 2.1, in its order."""
FIXED_STRUCTURE = (LE, MW, MAXWELL, KB)
"""Models with a given structure: only coefficients are identified."""


def inverted_linear(force_max: float, travel: float) -> TransferFunction:
    """Return the IL model: force 0 at contact, `force_max` after `travel`, with the sign opposite to the other models.

    Parameters
    ----------
    force_max, travel : float
        Force after `travel` in the output's unit; travel from contact in the input's unit; both above 0.

    Raises
    ------
    InputError
        If one of them is not above 0.
    """
    if force_max <= 0 or travel <= 0:
        raise InputError(
            f"tissue.inverted_linear: force_max {force_max:g}, travel {travel:g}; both must be > 0"
        )
    return TransferFunction((-force_max / travel,))


def higher_order_structures(order_max: int) -> list[ArxStructure]:
    """Return the structures of Eq. 3.9 for the search of HO, biproper and strictly proper.

    Parameters
    ----------
    order_max : int
        Largest order; the smallest is 2.
    """
    return [
        ArxStructure(order, tuple(range(first, last + 1)))
        for order in range(2, order_max + 1)
        for first in (0, 1)
        for last in range(first, order + 1)
    ]
