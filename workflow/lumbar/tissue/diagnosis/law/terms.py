"""The library of physical terms that a missing force may be a sum of; ``terms.yaml`` holds what they are products of."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.expression import Symbol, parse, substitute, symbols, to_text
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.parameter import Constant, NonlinearParameter


@dataclass(frozen=True)
class Term:
    """Quantity that a force may be proportional to."""

    name: str
    """Unique in the library."""
    words: str
    """Meaning, for a reader of the proposal."""
    parts: tuple[str, ...]
    """Expressions; each gets a linear parameter of its own. Of a term at the output, one: what the sensor makes of F."""
    nonlinear: tuple[NonlinearParameter, ...] = ()
    state: tuple[tuple[str, str], ...] = ()
    constants: tuple[Constant, ...] = ()
    knows: str = ""
    """Needs of the motion's past: ``""``, ``"memory"``, ``"path"`` or ``"time"``."""
    place: Place = Place.PARALLEL
    becomes: str = ""
    """Name of the term that it becomes at the largest lengths: of an exponential growth, what grows."""

    def rename(self, names: dict[str, str]) -> "Term":
        """The term with other symbols for its states and nonlinear parameters."""
        trees = {symbol: Symbol(name) for symbol, name in names.items()}

        def text(expression: str) -> str:
            return to_text(substitute(parse(expression), trees))

        return replace(
            self,
            parts=tuple(map(text, self.parts)),
            nonlinear=tuple(
                replace(item, symbol=names.get(item.symbol, item.symbol)) for item in self.nonlinear
            ),
            state=tuple((names.get(name, name), text(rate)) for name, rate in self.state),
        )

    def times(self, name: str, words: str, other: "Term") -> "Term":
        """Return the product with another term; parts, parameters and states of that one come last."""
        text = "*".join(item.parts[0] for item in (self, other) if item.parts != ("1",)) or "1"
        return replace(
            self,
            name=name,
            words=words,
            parts=(text,),
            nonlinear=self.nonlinear + other.nonlinear,
            state=self.state + other.state,
            constants=self.constants + other.constants,
            knows=self.knows + other.knows,
            becomes=name.removesuffix("_exp") if name.endswith("_exp") else "",
        )


@cache
def library() -> tuple[Term, ...]:
    """All terms: of the position alone, rate times depth, memory times depth, states on what they act on, and the others."""
    said = shipped_yaml(Path(__file__).with_suffix(".yaml"))
    nonlinear = {name: _parameter(**item) for name, item in said["parameters"].items()}
    constants = {symbol: Constant(symbol, **item) for symbol, item in said["constants"].items()}

    def terms(kind: str, prefix: str = "") -> dict[str, Term]:
        return {
            name: _term(f"{prefix}{name}", item, nonlinear, constants) for name, item in said[kind].items()
        }

    found = list(terms("positions", "position_").values())
    depths, carriers = terms("depths"), terms("carriers")
    for kind in ("rates", "memories"):
        for name, term in terms(kind).items():
            found += [
                depth.times(f"{name}_{key}".rstrip("_"), f"{term.words} {depth.words}".strip(), term)
                for key, depth in depths.items()
                if key in said[kind][name].get("depths", depths)
            ]
    for name, state in terms("states").items():
        for carrier, term in carriers.items():
            found.append(term.times(f"{carrier}_{name}", f"{term.words} {state.words}", state))
    return (*found, *terms("others").values())


def _parameter(start: list[float], reach: tuple[float, float] = (0.2, 5.0), **said) -> NonlinearParameter:
    return NonlinearParameter(low=start[0], high=start[1], reach=tuple(reach), **said)


def _term(name: str, said: Mapping, nonlinear: Mapping, constants: Mapping) -> Term:
    force = said["force"]
    parts = (force,) if isinstance(force, str) else tuple(force)
    signals = set().union(*(symbols(parse(part)) for part in parts))
    states = tuple(said.get("state", {}).items())
    return Term(
        name,
        said.get("words", ""),
        parts,
        tuple(nonlinear[key] for key in said.get("parameters", ())),
        states,
        tuple(constants[symbol] for symbol in said.get("constants", ())),
        "memory" if states else "path" if "s" in signals else "time" if "t" in signals else "",
        Place(said.get("place", Place.PARALLEL)),
    )


def knows(terms: tuple[Term, ...]) -> set[str]:
    """Return the needs of terms of the motion's past."""
    return {word for term in terms for word in ("memory", "path", "time") if word in term.knows}
