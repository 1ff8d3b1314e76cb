"""Library of physical terms; a missing force may be a sum of them. ``terms.yaml`` contains their factors."""

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
    """Name of the term, unique in the library."""
    words: str
    """Meaning of the term in a proposal."""
    parts: tuple[str, ...]
    """Expressions, each with a linear parameter; a term at the output has one, the sensor's reading as a function of F."""
    nonlinear: tuple[NonlinearParameter, ...] = ()
    state: tuple[tuple[str, str], ...] = ()
    constants: tuple[Constant, ...] = ()
    knows: str = ""
    """Required knowledge of the past motion: ``""``, ``"memory"``, ``"path"`` or ``"time"``."""
    place: Place = Place.PARALLEL
    becomes: str = ""
    """Name of the term that an exponential term becomes in the limit of large lengths; empty without a limit."""

    def rename(self, names: dict[str, str]) -> "Term":
        """Return the term with other symbols for its states and nonlinear parameters."""
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

    def times(self, name: str, meaning: str, other: "Term") -> "Term":
        """Return the product with another term; parameters and states of the other term are last."""
        text = "*".join(item.parts[0] for item in (self, other) if item.parts != ("1",)) or "1"
        return Term(
            name,
            meaning,
            (text,),
            self.nonlinear + other.nonlinear,
            self.state + other.state,
            self.constants + other.constants,
            self.knows + other.knows,
            self.place,
            name.removesuffix("_exp") if name.endswith("_exp") else "",
        )


@cache
def library() -> tuple[Term, ...]:
    """Return all terms: position only, rate times depth, memory times depth, states of carriers, and others."""
    content = shipped_yaml(Path(__file__).with_suffix(".yaml"))
    nonlinear = {key: _parameter(**item) for key, item in content["parameters"].items()}
    constants = {symbol: Constant(symbol, **item) for symbol, item in content["constants"].items()}

    def read(kind: str, prefix: str = "") -> dict[str, Term]:
        terms = {}
        for key, item in content[kind].items():
            force = item["force"]
            parts = (force,) if isinstance(force, str) else tuple(force)
            signals = set().union(*(symbols(parse(part)) for part in parts))
            states = tuple(item.get("state", {}).items())
            terms[key] = Term(
                f"{prefix}{key}",
                item.get("words", ""),
                parts,
                tuple(nonlinear[name] for name in item.get("parameters", ())),
                states,
                tuple(constants[symbol] for symbol in item.get("constants", ())),
                "memory" if states else "path" if "s" in signals else "time" if "t" in signals else "",
                Place(item.get("place", Place.PARALLEL)),
            )
        return terms

    terms = list(read("positions", "position_").values())
    depths, carriers = read("depths"), read("carriers")
    for kind in ("rates", "memories"):
        for name, term in read(kind).items():
            terms += [
                depth.times(f"{name}_{key}".rstrip("_"), f"{term.words} {depth.words}".strip(), term)
                for key, depth in depths.items()
                if key in content[kind][name].get("depths", depths)
            ]
    for name, state in read("states").items():
        for carrier, term in carriers.items():
            terms.append(term.times(f"{carrier}_{name}", f"{term.words} {state.words}", state))
    return (*terms, *read("others").values())


def _parameter(start: list[float], reach: tuple[float, float] = (0.2, 5.0), **fields) -> NonlinearParameter:
    return NonlinearParameter(low=start[0], high=start[1], reach=tuple(reach), **fields)


def knows(terms: tuple[Term, ...]) -> set[str]:
    """Return the kinds of knowledge of the past motion that terms require."""
    return {word for term in terms for word in ("memory", "path", "time") if word in term.knows}
