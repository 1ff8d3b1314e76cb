"""One recording in the forms that machines and people write it in."""

import numpy as np

RATE = 200.0
TIME = np.arange(600) / RATE
POSITION = 4 * np.sin(2 * np.pi * 1.1 * TIME) + 1.5 * np.sin(2 * np.pi * 3.3 * TIME + 1)
"""Millimetres."""
FORCE = 1.3 * POSITION + 0.05 * np.gradient(POSITION, TIME) + 0.02 * np.random.default_rng(5).normal(size=600)
"""Newtons; with noise, so that it is no designed signal."""
DIGITS = 5


def rows(
    delimiter: str,
    decimal: str = ".",
    columns=(TIME, POSITION, FORCE),
    digits: int = DIGITS,
    end: str = "",
    quote: str = "",
) -> str:
    """Lines of numbers."""

    def cell(value: float) -> str:
        return quote + ("" if np.isnan(value) else f"{value:.{digits}f}".replace(".", decimal)) + quote

    return "".join(delimiter.join(map(cell, row)) + end + "\n" for row in zip(*columns, strict=True))


INCH, POUND = 25.4, 4.4482216152605
PLAIN = (POSITION, FORCE)
KILONEWTONS = (TIME, POSITION, FORCE / 1e3)
LABVIEW = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
    "Multi_Headings\tNo\nDate\t2024/05/01\nTime\t12:03:01,123\n***End_of_Header***\t\n\nChannels\t2\t\t\n"
    "Samples\t600\t600\t\nY_Unit_Label\tmm\tN\t\nX_Dimension\tTime\tTime\t\nX0\t0,0\t0,0\t\n"
    "Delta_X\t0,005\t0,005\t\n***End_of_Header***\t\t\t\nX_Value\tDisplacement\tLoad\tComment\n"
)
INSTRON = (
    '"Results Table 1"\n"","Specimen label","Width"\n"1","A","10.0"\n"","",""\n'
    '"Time","Extension","Load"\n"(sec)","(mm)","(kN)"\n'
)
MTS = (
    "MTS793|MPT|ENU|1|2|/|:|1|0|0|A\n\nData Acquisition: Timed\t\t\tTime: 3 Sec\tDate: 5/1/2024\n"
    "Ch 1 Displacement\tCh 1 Force\tRunning Time\nin\tlbf\tSec\n"
)
WAVE_MATRIX = (
    '"Total Time (s)","Cycle Elapsed Time (s)","Total Cycles","Step",'
    '"Position(Linear:Digital Position) (mm)","Load(Linear:Load) (kN)"\n'
)
OTHERS = "Index;Zeit ms;Sollweg mm;Weg mm;Geschwindigkeit mm/s;Kraft N\n"


def _dated() -> str:
    """Stamps that pass midnight."""
    clock = [f"01.05.2024 23:59:{58 + t:06.3f}" if t < 2 else f"02.05.2024 00:00:{t - 2:06.3f}" for t in TIME]
    lines = rows(";", ",", PLAIN).splitlines(True)
    stamped = (f"{stamp};{line}" for stamp, line in zip(clock, lines, strict=True))
    return "Datum/Uhrzeit;Weg [mm];Kraft [N]\n" + "".join(stamped)


def _exponents() -> str:
    lines = (f"{t:.6E}\t{z / 1e3:.7E}\t{f:.7E}\n" for t, z, f in zip(TIME, POSITION, FORCE, strict=True))
    return "time[s]\tdisplacement[m]\tforce[N]\n" + "".join(lines)


def _texts() -> dict[str, str]:
    beside = (np.arange(600.0), 1e3 * TIME, POSITION + 0.1, POSITION, np.gradient(POSITION, TIME), FORCE)
    cycles = (TIME, TIME % 0.9, TIME // 0.9, 1 + 0 * TIME, POSITION, FORCE / 1e3)
    labview = LABVIEW + rows("\t", ",", end="\t")
    tidy = "time_s,position_mm,force_N\n" + rows(",")
    counts = rows(",", columns=(TIME, POSITION * 100, FORCE / 35.15), digits=8)
    footer = rows(",", end=",OK") + "\nPeak load,5.1\nEnd of test\n"
    temperature = rows(";", ",", (TIME, POSITION, FORCE, 20 + 0 * TIME))
    imperial = rows("\t", columns=(POSITION / INCH, FORCE / POUND, TIME), digits=8)
    small = rows(";", ",", (FORCE / 1e3, TIME, 1e3 * POSITION), 9)
    base = rows("   ", columns=(1e3 * TIME, POSITION / 1e3, FORCE), digits=8)
    return {
        "tidy.csv": tidy,
        "excel_deutsch.csv": "\ufeffZeit [s];Weg [mm];Kraft [N]\n" + rows(";", ","),
        "umlaut.txt": "Prüfkraft in kN;Prüfzeit in s;Standardweg in µm\n" + small,
        "labview.lvm": labview,
        "labview_utf16.lvm": labview,
        "labview_without_x.lvm": LABVIEW + rows("\t", ",", (np.full(len(TIME), np.nan), *PLAIN)),
        "instron.csv": INSTRON + rows(",", columns=KILONEWTONS, digits=8, quote='"'),
        "instron_excel_comma.csv": INSTRON + rows(",", ",", KILONEWTONS, digits=8, quote='"'),
        "mts.dat": MTS + imperial,
        "blanks.txt": "% bench 3\n% time_ms   pos_m    F_N\n" + base,
        "blanks_in_names.txt": "Elapsed time (s)  Tool depth (mm)  Load cell (N)\n" + rows("  "),
        "blanks_decimal_comma.txt": "t(s) Weg(mm) Kraft(N)\n" + rows(" ", ","),
        "francais.csv": "Temps (s);Déplacement (mm);Effort (N);Température (°C)\n" + temperature,
        "rate_in_header.txt": "Operator: X; Y\nSampling frequency: 200 Hz\nposition/mm,force/N\n" + rows(",", ".", PLAIN),
        "rate_told.txt": "position/mm,force/N\n" + rows(",", ".", PLAIN),
        "nameless.txt": rows("\t"),
        "counts.csv": "time_s,encoder [counts],torque transducer [V]\n" + counts,
        "footer.csv": "time (s),stroke (mm),load (N),status\n" + footer,
        "dates.csv": _dated(),
        "zwick.txt": '"Prüfzeit"\t"Standardweg"\t"Standardkraft"\n"s"\t"mm"\t"N"\n' + rows("\t", ",", end="\t"),
        "wave_matrix.csv": WAVE_MATRIX + rows(",", columns=cycles, digits=8),
        "exponents.txt": _exponents(),
        "excel_sep.csv": "sep=;\r\nZeit;Weg;Kraft\r\ns;mm;N\r\n" + rows(";", ","),
        "line_break_in_names.csv": '"Time\n(s)","Position\n(mm)","Force\n(N)"\n' + rows(","),
        "units_above_names.txt": "s|mm|N\nTime|Position|Force\n" + rows("|"),
        "old_mac_minus.csv": tidy.replace("-", "\N{MINUS SIGN}").replace("\n", "\r"),
        "others_beside.csv": OTHERS + rows(";", ",", beside),
    }  # fmt: skip


ENCODINGS = {
    "umlaut.txt": "cp1252",
    "labview_utf16.lvm": "utf-16",
    "francais.csv": "latin-1",
    "zwick.txt": "cp1252",
}
COUNTS = {"position": "encoder", "position_unit": "0.01 mm", "force": 3, "force_unit": "35.15 N/V"}
TOLD = {
    "rate_told.txt": {"rate": 200},
    "nameless.txt": {"position_unit": "mm", "force_unit": "N"},
    "counts.csv": COUNTS,
}
"""What a file itself does not say."""


def foreign_files() -> dict[str, tuple[bytes, dict]]:
    """Content and what has to be told, by the name of a file; each states the recording above."""
    return {
        name: (text.encode(ENCODINGS.get(name, "utf-8")), TOLD.get(name, {}))
        for name, text in _texts().items()
    }
