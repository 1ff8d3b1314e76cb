"""The reader of numbers under a header: lines, rows, numbers."""

import re

import numpy as np
import pytest

from lumbar.records.number_table import (
    Dialect,
    NumberTable,
    Row,
    decode_lines,
    parse_number,
    read_format_numbers,
    read_numbers,
    split_rows,
)
from refusing import has_tokens, refusal

ROWS = np.random.default_rng(3).normal(0, 1e3, (40, 3)).round(6)


def text_of(delimiter: str, decimal: str = ".") -> list[str]:
    return [delimiter.join(f"{value!r}".replace(".", decimal) for value in row) for row in ROWS.tolist()]


def read(lines, dialect=None, columns=None, **options) -> NumberTable:
    dialect = dialect or Dialect()
    rows = split_rows(lines, dialect, "a.csv")
    return read_numbers(rows, columns or {"x": 0, "y": 1, "z": 2}, "a.csv", dialect, **options)


@pytest.mark.parametrize(
    "dialect", [Dialect(), Dialect("\t"), Dialect(";", ","), Dialect(None), Dialect("|", ",")], ids=str
)
def test_plain_reader_agrees_with_row_reader(dialect):
    lines = text_of(dialect.delimiter or "  ", dialect.decimal)
    table, plain = read(lines, dialect), read_format_numbers(lines, dialect, 3)
    np.testing.assert_array_equal(table.values, ROWS)
    np.testing.assert_array_equal(plain.values, ROWS)
    assert list(table.lines) == list(plain.lines) == list(range(1, 41))


@pytest.mark.parametrize("line", ["1,2", "1,2,3,4", "1,2,x", "1,2,inf", "# 1,2,3", "", '1,2,"3"'])
def test_plain_reader_rejects_irregular_tables(line):
    lines = text_of(",")
    assert read_format_numbers([*lines[:9], line, *lines[9:]], Dialect(), 3) is None
    assert read_format_numbers([line, *lines], Dialect(), 3) is None


def test_plain_reader_reads_missing_cells_and_times_of_day():
    lines = [*text_of(",")[:9], "1,nan,", ",2,12:00:01"]
    readers = {2: lambda cells: np.array([float(cell[-2:]) if ":" in cell else np.nan for cell in cells])}
    expected = [[1, np.nan, np.nan], [np.nan, 2, 1]]
    np.testing.assert_array_equal(read_format_numbers(lines, Dialect(), 3, 1, readers).values[9:], expected)


def test_rows_have_line_numbers_of_file():
    lines = ["# made up", "", "x,y,z", "", "1, 2 ,3", "#", '4,"5,5",6']
    rows = list(split_rows(lines, Dialect(comment="#"), "a.csv", first=5))
    assert rows == [Row(7, ["x", "y", "z"]), Row(9, ["1", "2", "3"]), Row(11, ["4", "5,5", "6"])]


def test_quotes_join_lines_only_if_the_dialect_allows_it():
    lines = ["who,why", 'a,"first', 'second"', "b,none"]
    several = Dialect(quotes_span_lines=True)
    assert [row.line for row in split_rows(lines, several, "a.csv")] == [1, 2, 4]
    assert [row.line for row in split_rows(lines, Dialect(), "a.csv")] == [1, 2, 3, 4]
    rows = split_rows(["a,b", '"' + "x" * 200_000], several, "a.csv")
    assert has_tokens(refusal(list, rows), "a.csv … line 2 … row")


def test_all_wrong_cells_are_listed_with_line_and_column():
    message = refusal(read, ["1,2,3", "1,,3", "1,2", "", "1,abc,1_0", f"1,2,{'9' * 100}x"])
    for tokens in ("line 2: y … ''", "line 3: 2 cells … 3", "line 5: y … 'abc'", "line 5: z … '1_0'"):
        assert has_tokens(message, tokens), tokens
    assert has_tokens(message, f"line 6: z … '{'9' * 60}") and "9" * 61 not in message


def test_empty_cells_are_missing_only_in_columns_that_allow_it():
    table = read(["1,2,3", ",2,3"], may_be_empty=["x"])
    assert np.isnan(table.values[1, 0]) and table.values[1, 1] == 2
    assert has_tokens(refusal(read, ["1,2,3", ",2,3"], may_be_empty=["y"]), "line 2: x … ''")


def test_narrow_table_names_missing_column():
    assert has_tokens(refusal(read, ["1,2", "3,4"]), "line 1: 2 columns … z … column 3")


@pytest.mark.parametrize(("text", "value"), [("1D3", 1e3), ("-2.5d-01", -0.25), (".5", 0.5), ("+1E2", 100)])
def test_exponents_of_fortran_and_signs_are_read(text, value):
    assert parse_number(text) == value


@pytest.mark.parametrize("text", ["1_000", "١٢", "0x10", "1,5", "d3", "1d", ""])
def test_invalid_numbers_are_rejected(text):
    with pytest.raises(ValueError, match=re.escape(repr(text))):
        parse_number(text)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"])
def test_encodings_of_western_text_are_recognised(encoding):
    text = "Prüfkraft µm\r\n1,5\r2\n"
    assert decode_lines(text.encode(encoding), "a.csv")[0] == ["Prüfkraft µm", "1,5", "2", ""]


def test_other_encodings_are_rejected_unless_lenient():
    content = "a\nМаркер".encode("cp1251")
    assert has_tokens(refusal(decode_lines, content, "a.csv"), "a.csv … line 2 … UTF-8")
    assert decode_lines(content, "a.csv", lenient=True)[0][0] == "a"
