"""Excel workbooks (.xlsx): a sheet is read as the text table it shows."""

from __future__ import annotations

import io

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import RawTable
from lumbar.records.importing.text_table import table_of_lines
from lumbar.records.unpacking import check_zip


def read_workbook(content: bytes, source: str, table: str | None = None) -> RawTable:
    """Read one sheet; parameters as of `lumbar.records.importing.text_table.read_text`, `table` being the sheet.

    Raises
    ------
    InputError
        If openpyxl is not installed, several sheets hold something, or there is no table.
    """
    try:
        import openpyxl
    except ImportError as error:
        raise InputError(
            f"{source}: an Excel workbook needs the package openpyxl: pip install 'lumbar[import]'"
        ) from error
    check_zip(content, source)
    try:
        book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        sheets = {sheet.title: [_line(row) for row in sheet.iter_rows(values_only=True)] for sheet in book}
    except Exception as error:  # a zip that is no workbook, or a broken one, leads to errors of many kinds
        raise InputError(f"{source}: not an Excel workbook that can be read ({error})") from error
    filled = {title: lines for title, lines in sheets.items() if any(line.strip() for line in lines)}
    if table is None and len(filled) != 1:
        raise InputError(
            f"{source}: {len(filled)} sheets hold something: {', '.join(filled)}; choose by --sheet NAME"
        )
    title = table if table is not None else next(iter(filled))
    if title not in filled:
        raise InputError(f"{source}: no sheet {title!r}; there are {', '.join(filled)}")
    return table_of_lines(filled[title], source, f"sheet {title!r}")


def _line(row: tuple) -> str:
    return "\t".join("" if cell is None else str(cell).replace("\t", " ") for cell in row)
