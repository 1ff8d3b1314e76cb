"""Recordings as files of columns."""

import numpy as np


def write_columns(path, decimals: str = "%.17g", **columns) -> None:
    """Write a CSV file whose header names the columns."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, decimals, ",", header=",".join(columns), comments="")


def write_records(folder, records, decimals: str = "%.17g"):
    """Write each record of position and force as a file of its name; the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for record in records:
        values = {"time_s": record.time, "position_mm": record["input"], "force_N": record["output"]}
        write_columns(folder / f"{record.name}.csv", decimals, **values)
    return folder
