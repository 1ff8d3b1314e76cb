"""Colours of models, segments and anything else, the same in all figures and on all pages.

Colours are those of Okabe and Ito (Color Universal Design, 2008), picked so that their lightness differs: with the
line styles and markers given here every figure can be read in grey.
"""

MEASURED = "#000000"
MODELS = {
    "IL": {"color": "#999999", "linestyle": (0, (1, 1)), "marker": "x", "hatch": ".."},
    "MW": {"color": "#E69F00", "linestyle": (0, (4, 1.5)), "marker": "s", "hatch": "//"},
    "Maxwell": {"color": "#CC79A7", "linestyle": (0, (6, 1.5, 1, 1.5)), "marker": "D", "hatch": "--"},
    "KB": {"color": "#0072B2", "linestyle": "-", "marker": "o", "hatch": ""},
    "HO": {"color": "#D55E00", "linestyle": (0, (2, 1)), "marker": "^", "hatch": "xx"},
    "LE": {"color": "#56B4E9", "linestyle": (0, (1, 2)), "marker": "+", "hatch": "||"},
    "KV": {"color": "#009E73", "linestyle": (0, (5, 1, 1, 1, 1, 1)), "marker": "v", "hatch": "\\\\"},
}
"""Colour, line style, marker and hatch of every model, the same in all figures."""
WITH_EFFECTS = {"color": "#882255", "linestyle": (0, (3, 1, 1, 1)), "marker": "*", "hatch": "oo"}
"""Look of a base model with effects added."""


def model_look(name: str) -> dict:
    """Colour, line style, marker and hatch of a model by its name."""
    return MODELS.get(name, WITH_EFFECTS)


def model_line(name: str) -> dict:
    """Colour and line style of a model by its name."""
    return {key: model_look(name)[key] for key in ("color", "linestyle")}


SEGMENTS = {"thorax": "#0072B2", "abdomen": "#E69F00", "pelvis": "#009E73"}
"""Colour of the three trunk segments."""
SERIES = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
"""Colours for anything else, in the order in which they are used."""
