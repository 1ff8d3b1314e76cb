"""A table as LaTeX that stands in a journal's column, or across both where it needs to."""

from __future__ import annotations

import re
from collections.abc import Sequence

from lumbar.tables.layout import EMPTY, Column, split_number

COLUMN_WIDTH = 52
"""Characters in ``\\footnotesize`` across a journal's column."""
ROWS = 45
"""Rows of one page: what is longer goes on in a table without a number of its own."""
_WORDS = 30
_ESCAPES = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "&": r"\&",
        "%": r"\%",
        "$": r"\$",
        "#": r"\#",
        "_": r"\_",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
    }
)
_POWER = re.compile("·10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)")
_PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_NUMBERED = re.compile(r"^Table \d+\.\d+[.:,]? *(as |the )?")


def escape_latex(text: str) -> str:
    """Return a text as LaTeX prints it."""
    written = text.translate(_ESCAPES)
    return _POWER.sub(lambda found: rf"$\cdot10^{{{found[1].translate(_PLAIN)}}}$", written)


def latex_table(title: str, columns: Sequence[Column], remarks: Sequence[str], data: str) -> str:
    """Return ``booktabs`` table environments; the number in the title is left to LaTeX.

    Parameters
    ----------
    remarks : sequence of str
        What stands below.
    data : str
        Where the data come from.
    """
    wide = sum(column.width for column in columns) > COLUMN_WIDTH
    environment = "table*" if wide else "table"
    rows = len(columns[0].cells) if columns else 0
    parts = [range(start, min(start + ROWS, rows)) for start in range(0, rows, ROWS)] or [range(0)]
    lines = [
        r"% needs \usepackage{array,booktabs}; compile with LuaLaTeX or XeLaTeX, which know the Greek letters"
    ]
    for number, part in enumerate(parts):
        caption = f"{_unnumbered(title)} Data: {data}." if number == 0 else "(continued)"
        lines += [
            rf"\begin{{{environment}}}",
            *([] if number == 0 else [r"\addtocounter{table}{-1}"]),
            r"\footnotesize",
            rf"\caption{{{escape_latex(caption)}}}",
            rf"\begin{{tabular}}{{@{{}}{''.join(map(_alignment, columns))}@{{}}}}",
            r"\toprule",
            " & ".join(_head(column) for column in columns) + r" \\",
            r"\midrule",
            *(" & ".join(_cell(column, row) for column in columns) + r" \\" for row in part),
            r"\bottomrule",
            r"\end{tabular}",
        ]
        if part is parts[-1]:
            told = " ".join(f"{text.rstrip('.')}." for text in remarks)
            lines.append(rf"\par\smallskip\parbox{{\linewidth}}{{\raggedright {escape_latex(told)}}}")
        lines.append(rf"\end{{{environment}}}")
    return "\n".join(lines) + "\n"


def _unnumbered(title: str) -> str:
    rest = _NUMBERED.sub("", title)
    return rest[:1].upper() + rest[1:] if rest else title


def _alignment(column: Column) -> str:
    if column.numeric:
        return "r"
    return "l" if column.longest <= _WORDS else rf">{{\raggedright\arraybackslash}}p{{{_WORDS / 2:g}em}}"


def _head(column: Column) -> str:
    """Header with its words below one another where they are wider than the cells."""
    lines, room = [""], max(column.width, 8)
    for word in column.header.split():
        if lines[-1] and len(lines[-1]) + len(word) >= room:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip()
    if len(lines) == 1:
        return escape_latex(lines[0])
    side = "r" if column.numeric else "l"
    stacked = r" \\ ".join(map(escape_latex, lines))
    return rf"\begin{{tabular}}[b]{{@{{}}{side}@{{}}}}{stacked}\end{{tabular}}"


def _cell(column: Column, row: int) -> str:
    """Cell, filled up with invisible digits behind the decimal sign so that the signs stand below one another."""
    text = column.cells[row]
    if not column.numeric or text == EMPTY or "·" in text:
        return escape_latex(text)
    missing = column.fraction - len(split_number(text)[1])
    fill = "." + "0" * (missing - 1) if missing == column.fraction else "0" * missing
    return escape_latex(text).replace("-", "$-$", 1) + (rf"\phantom{{{fill}}}" if missing else "")
