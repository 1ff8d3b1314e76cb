"""Keys of the YAML files of effects and bases, of the catalogue and of users.

``docs/tissue/own_effect.md`` describes a file. Only files of the catalogue may name code in `lumbar.tissue.effects.hooks`.
"""

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import YamlFile
from lumbar.settings.section import Section
from lumbar.settings.validation import Origins, check_types
from lumbar.tissue.effects.hooks import HOOKS
from lumbar.tissue.models.expression import parse
from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.parameter import Constant, LinearParameter, NonlinearParameter, Scale

NAME = re.compile(r"[a-z][a-z0-9_]*")
_SIGNS = {"positive": 1, "negative": -1, "any": 0}
_NONLINEAR_KEYS = {"start", "scale", "points", "reach", "lines", "follows_record", "decisive"}


def _require(is_valid: Callable[[Any], bool], message: str) -> AfterValidator:
    """Return a validator that rejects invalid values with a message about them."""

    def check(value: Any) -> Any:
        if not is_valid(value):
            raise ValueError(message.format(value))
        return value

    return AfterValidator(check)


def _check_expression(text: str) -> str:
    try:
        parse(text)
    except InputError as error:
        raise ValueError(str(error)) from None
    return text


Text = Annotated[str, AfterValidator(lambda text: " ".join(text.split()))]
Needed = Annotated[Text, _require(bool, "is missing; a text is needed")]
Name = Annotated[str, Field(pattern=f"^{NAME.pattern}$")]
Unit = Annotated[
    Needed,
    _require(
        lambda unit: not set("{}") & set(re.sub(r"\{[xy]\}", "", unit)),
        "{!r}: units are those of the input {{x}} and the output {{y}}, s, 1 …",
    ),
]
Expression = Annotated[Needed, AfterValidator(_check_expression)]
Above0 = Annotated[float, Field(gt=0)]
Range = Annotated[
    tuple[Above0, Above0],
    _require(
        lambda ends: ends[0] <= ends[1], "[{0[0]}, {0[1]}]: two numbers above 0 are needed, the lower first"
    ),
]


class StateEntry(Section):
    """A state of an equation."""

    rate: Expression
    """Rate of change per second."""
    start: Annotated[Text, AfterValidator(lambda text: _check_expression(text) if text else text)] = ""
    """Value when a record begins; default 0."""


# A state may be given by its rate only.
StateOrRate = Annotated[
    StateEntry, BeforeValidator(lambda value: {"rate": value} if isinstance(value, str) else value)
]


class ParameterEntry(Section):
    """A parameter of an equation; it is nonlinear if it has the keys start and scale."""

    name: Name
    """Name in results and C code: letters a to z, digits and _, a letter first."""
    unit: Unit
    """Unit in terms of {x} (input) and {y} (output)."""
    latex: Text = ""
    """Symbol in LaTeX; default from its symbol in the equation."""
    sign: Literal["positive", "negative", "any"] = "positive"
    """Sign of a linear parameter."""
    start: Range | None = None
    """Range of starting values of the fit, in units of the scale."""
    scale: Scale | None = None
    """Quantity of the record that sets the size of the parameter."""
    points: int = Field(5, ge=1, le=20)
    """Number of starting values."""
    reach: tuple[Annotated[float, Field(gt=0, le=1)], Annotated[float, Field(ge=1)]] = (0.1, 10.0)
    """Factors by which the fit may go below and above the range."""
    lines: float | None = Field(None, gt=0)
    """Half-width of the bounds of a fitted frequency, in frequency lines (1/duration)."""
    follows_record: bool = False
    """True if the range grows with the sampling interval and the duration of the record."""
    decisive: bool = False
    """True if a value at the end of its range means that the mechanism is absent."""

    @model_validator(mode="after")
    def _check_kind(self) -> Self:
        given, ends = self.model_fields_set, {"start", "scale"} & self.model_fields_set
        if len(ends) == 1:
            raise ValueError(f"{ends.pop()} alone: a nonlinear parameter needs start and scale")
        kind, others = ("nonlinear", {"sign"}) if ends else ("linear", _NONLINEAR_KEYS)
        if wrong := sorted(given & others):
            raise ValueError(f"{', '.join(wrong)}: not of a {kind} parameter")
        return self

    def parameter(self, symbol: str) -> LinearParameter | NonlinearParameter:
        """Return the parameter with this symbol in the equation."""
        named = {"name": self.name, "unit": self.unit, "symbol": symbol, "latex": self.latex}
        if self.start is None or self.scale is None:
            return LinearParameter(**named, sign=_SIGNS[self.sign])
        more = self.model_dump(include={"points", "reach", "lines", "follows_record", "decisive"})
        return NonlinearParameter(**named, scale=self.scale, low=self.start[0], high=self.start[1], **more)


class ConstantEntry(Section):
    """A fixed number with a symbol in an equation."""

    value: float
    """Finite number."""
    unit: Unit
    """Unit in terms of {x} (input) and {y} (output)."""
    latex: Text = ""
    """Symbol in LaTeX; default from its symbol in the equation."""
    scale: Scale | Literal[""] = ""
    """Quantity of the record that is the unit of the constant in a fit."""


class EquationEntry(Section):
    """An equation with its symbols."""

    equation: Expression
    """Force in terms of parameters and signals; with place: output also of the force F."""
    state: dict[str, StateOrRate] = Field({})
    """States by symbol, each with its rate or with rate and start."""
    parameters: dict[str, ParameterEntry] = Field({})
    """Parameters by symbol, each with name and unit."""
    constants: dict[str, ConstantEntry] = Field({})
    """Constants by symbol, each with value and unit."""

    @field_validator("parameters")
    @classmethod
    def _check_names(cls, parameters: dict[str, ParameterEntry]) -> dict[str, ParameterEntry]:
        _check_distinct([item.name for item in parameters.values()], "parameter")
        return parameters

    def form(self, name: str = "equation", **more: Any) -> Form:
        """Return the equation as a form."""
        parameters = [item.parameter(symbol) for symbol, item in self.parameters.items()]
        return Form(
            name=name,
            state=tuple((symbol, item.rate) for symbol, item in self.state.items()),
            start=tuple((symbol, item.start) for symbol, item in self.state.items() if item.start),
            linear=tuple(item for item in parameters if isinstance(item, LinearParameter)),
            nonlinear=tuple(item for item in parameters if isinstance(item, NonlinearParameter)),
            constants=tuple(Constant(symbol, **item.model_dump()) for symbol, item in self.constants.items()),
            **{"equation": self.equation, "place": Place.PARALLEL, **more},
        )


class FormEntry(EquationEntry):
    """One form of an effect."""

    place: Literal["parallel", "output"] = "parallel"
    """parallel: a force that is added to the tissue's; output: the measured force as a function of F."""
    general: bool = False
    """True if it contains other forms of the effect as special cases."""
    one_axis: bool = False
    """True if it has no equivalent in space."""
    essential: tuple[str, ...] = ()
    """Names of linear parameters without which the mechanism is absent."""

    def form(self, name: str = "equation", **more: Any) -> Form:
        """Return the form of an effect."""
        flags = self.model_dump(include={"general", "one_axis", "essential"})
        return super().form(name, place=Place(self.place), **flags, **more)


class NamedForm(FormEntry):
    """One of several forms of an effect."""

    name: Name
    """Name of the form: letters a to z, digits and _, a letter first."""


class HookedForm(NamedForm):
    """A form of the catalogue, which may name code in `HOOKS`."""

    equation: Text = ""
    place: Literal["parallel", "output", "input"] = "parallel"
    latex: Text = ""
    solution: str | None = None
    by_hand: str | None = None
    starts: str | None = None
    contradiction: str | None = None

    def form(self, name: str = "equation", **more: Any) -> Form:
        """Return the form with the code that its keys name."""
        names = {key: getattr(self, key) for key in HOOKS}
        code = {key: HOOKS[key][hook] for key, hook in names.items() if hook is not None}
        if "solution" in code:
            code["solution"], code["c_solution"] = code["solution"]
        if "by_hand" in code:
            code["hand_written"], code["equation"] = code.pop("by_hand"), self.latex
        return super().form(name, **code, **more)


class Description(Section):
    """Name and texts of an effect or a base."""

    name: Name
    """Name in results and C code: letters a to z, digits and _, a letter first."""
    mechanism: Needed
    """One sentence for the reader of a report."""
    source: Text = ""
    """Reference; default the name of the file."""


class EffectDescription(Description):
    """An effect without its forms."""

    experiment: Text = ""
    """Excitation that shows the effect best."""
    sensors: Text = ""
    """Part of the measuring chain that looks the same in the records."""
    accumulates: bool = False
    """True if it grows with time or path."""
    unrepeated: bool = False
    """True if it has its own clock."""
    linear: bool = False
    """True if a linear time-invariant model stays linear with it."""
    rate_independent: bool = False
    """True if its force is the same at any speed."""
    rival: bool = False
    """True if it is only compared with similar effects that were selected."""

    def effect(self, forms: Collection[Form], file: YamlFile, definition: Mapping | None = None) -> Effect:
        """Return the effect with its forms; `definition` is the content of a user's file."""
        fields = self.model_dump(include=set(EffectDescription.model_fields))
        fields |= {"source": self.source or Path(file.path).name, "definition": definition}
        return Effect(**fields, forms=tuple(forms))


class EffectOfOneForm(FormEntry, EffectDescription):
    """A file with one equation."""

    @field_validator("essential")
    @classmethod
    def _check_essential(cls, names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        _check_linear(names, [info.data.get("parameters", {})])
        return names


class EffectOfForms(EffectDescription):
    """A file with several forms."""

    forms: tuple[NamedForm, ...] = Field(min_length=1)
    """List of forms, each with name, equation, parameters …"""

    @field_validator("forms")
    @classmethod
    def _check_forms(cls, forms: tuple[NamedForm, ...]) -> tuple[NamedForm, ...]:
        _check_distinct([form.name for form in forms], "form")
        _check_linear(
            [name for form in forms for name in form.essential], [form.parameters for form in forms]
        )
        return forms


class HookedEffect(EffectDescription):
    """A file of the catalogue."""

    forms: tuple[HookedForm, ...] = Field(min_length=1)


class BaseEntry(EquationEntry, Description):
    """A file of a user-defined base."""


def _check_distinct(names: list[str], kind: str) -> None:
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"{', '.join(repeated)} is a duplicate; each {kind} needs its own name")


def _check_linear(names: Iterable[str], parameters: Iterable[Mapping[str, ParameterEntry]]) -> None:
    """Raise if any of the names is not a linear parameter of any form."""
    linear = {item.name for form in parameters for item in form.values() if item.scale is None}
    if unknown := sorted(set(names) - linear):
        raise ValueError(f"{', '.join(unknown)}; linear parameters are {', '.join(sorted(linear))}")


Kind = TypeVar("Kind", bound=Section)


def read_entry(file: YamlFile, kind: type[Kind], problems: Problems, taken: Collection[str] = ()) -> Kind:
    """Return the content of a file as an entry of a kind.

    Parameters
    ----------
    file : YamlFile
        Content with its lines.
    kind : type
        Class of the entry.
    problems : Problems
        Problems found so far.
    taken : collection of str
        Names that are not allowed for the entry.

    Raises
    ------
    InputError
        If there are problems. The message lists key and line of each.
    """
    origins = Origins(problems, [file])
    entry = check_types(file.content, kind, origins)
    if (name := file.content.get("name")) in taken:
        origins.add("name", f"{name!r} is taken in the catalogue", "choose another")
    problems.raise_if_any()
    assert entry is not None  # else there were problems
    return entry
