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


def foreign_files() -> dict[str, tuple[bytes, dict]]:
    """Content and what has to be told, by the name of a file.

    Each states the recording above; what is told is what the file itself does not say.
    """
    inch, pound = 25.4, 4.4482216152605
    labview = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
        "Multi_Headings\tNo\nDate\t2024/05/01\nTime\t12:03:01,123\n***End_of_Header***\t\n\nChannels\t2\t\t\n"
        "Samples\t600\t600\t\nY_Unit_Label\tmm\tN\t\nX_Dimension\tTime\tTime\t\nX0\t0,0\t0,0\t\n"
        "Delta_X\t0,005\t0,005\t\n***End_of_Header***\t\t\t\nX_Value\tDisplacement\tLoad\tComment\n"
    )
    instron = (
        '"Results Table 1"\n"","Specimen label","Width"\n"1","A","10.0"\n"","",""\n'
        '"Time","Extension","Load"\n"(sec)","(mm)","(kN)"\n'
    )
    mts = (
        "MTS793|MPT|ENU|1|2|/|:|1|0|0|A\n\nData Acquisition: Timed\t\t\tTime: 3 Sec\tDate: 5/1/2024\n"
        "Ch 1 Displacement\tCh 1 Force\tRunning Time\nin\tlbf\tSec\n"
    )
    clock = [f"01.05.2024 23:59:{58 + t:06.3f}" if t < 2 else f"02.05.2024 00:00:{t - 2:06.3f}" for t in TIME]
    dated = "Datum/Uhrzeit;Weg [mm];Kraft [N]\n" + "".join(
        f"{stamp};{line}"
        for stamp, line in zip(clock, rows(";", ",", (POSITION, FORCE)).splitlines(True), strict=True)
    )
    return {
        "tidy.csv": (("time_s,position_mm,force_N\n" + rows(",")).encode(), {}),
        "excel_deutsch.csv": (("\ufeffZeit [s];Weg [mm];Kraft [N]\n" + rows(";", ",")).encode(), {}),
        "umlaut.txt": (
            (
                "Prüfkraft in kN;Prüfzeit in s;Standardweg in µm\n"
                + rows(";", ",", (FORCE / 1e3, TIME, 1e3 * POSITION), 9)
            ).encode("cp1252"),
            {},
        ),
        "labview.lvm": ((labview + rows("\t", ",", end="\t")).encode(), {}),
        "labview_utf16.lvm": ((labview + rows("\t", ",", end="\t")).encode("utf-16"), {}),
        "labview_without_x.lvm": (
            (labview + rows("\t", ",", columns=(np.full(len(TIME), np.nan), POSITION, FORCE))).encode(),
            {},
        ),
        "instron.csv": (
            (instron + rows(",", columns=(TIME, POSITION, FORCE / 1e3), digits=8, quote='"')).encode(),
            {},
        ),
        "instron_excel_comma.csv": (
            (instron + rows(",", ",", columns=(TIME, POSITION, FORCE / 1e3), digits=8, quote='"')).encode(),
            {},
        ),
        "mts.dat": (
            (mts + rows("\t", columns=(POSITION / inch, FORCE / pound, TIME), digits=8)).encode(),
            {},
        ),
        "blanks.txt": (
            (
                "% bench 3\n% time_ms   pos_m    F_N\n"
                + rows("   ", columns=(1e3 * TIME, POSITION / 1e3, FORCE), digits=8)
            ).encode(),
            {},
        ),
        "blanks_in_names.txt": (
            ("Elapsed time (s)  Tool depth (mm)  Load cell (N)\n" + rows("  ")).encode(),
            {},
        ),
        "blanks_decimal_comma.txt": (("t(s) Weg(mm) Kraft(N)\n" + rows(" ", ",")).encode(), {}),
        "francais.csv": (
            (
                "Temps (s);Déplacement (mm);Effort (N);Température (°C)\n"
                + rows(";", ",", (TIME, POSITION, FORCE, 20 + 0 * TIME))
            ).encode("latin-1"),
            {},
        ),
        "rate_in_header.txt": (
            (
                "Operator: X; Y\nSampling frequency: 200 Hz\nposition/mm,force/N\n"
                + rows(",", columns=(POSITION, FORCE))
            ).encode(),
            {},
        ),
        "rate_told.txt": (
            ("position/mm,force/N\n" + rows(",", columns=(POSITION, FORCE))).encode(),
            {"rate": 200},
        ),
        "nameless.txt": (rows("\t").encode(), {"position_unit": "mm", "force_unit": "N"}),
        "counts.csv": (
            (
                "time_s,encoder [counts],torque transducer [V]\n"
                + rows(",", columns=(TIME, POSITION * 100, FORCE / 35.15), digits=8)
            ).encode(),
            {"position": "encoder", "position_unit": "0.01 mm", "force": 3, "force_unit": "35.15 N/V"},
        ),
        "footer.csv": (
            (
                "time (s),stroke (mm),load (N),status\n"
                + rows(",", end=",OK")
                + "\nPeak load,5.1\nEnd of test\n"
            ).encode(),
            {},
        ),
        "dates.csv": (dated.encode(), {}),
        "zwick.txt": (
            (
                '"Prüfzeit"\t"Standardweg"\t"Standardkraft"\n"s"\t"mm"\t"N"\n' + rows("\t", ",", end="\t")
            ).encode("cp1252"),
            {},
        ),
        "wave_matrix.csv": (
            (
                '"Total Time (s)","Cycle Elapsed Time (s)","Total Cycles","Step",'
                '"Position(Linear:Digital Position) (mm)","Load(Linear:Load) (kN)"\n'
                + rows(
                    ",",
                    columns=(TIME, TIME % 0.9, TIME // 0.9, 1 + 0 * TIME, POSITION, FORCE / 1e3),
                    digits=8,
                )
            ).encode(),
            {},
        ),
        "exponents.txt": (
            (
                "time[s]\tdisplacement[m]\tforce[N]\n"
                + "".join(
                    f"{t:.6E}\t{z / 1e3:.7E}\t{f:.7E}\n"
                    for t, z, f in zip(TIME, POSITION, FORCE, strict=True)
                )
            ).encode(),
            {},
        ),
        "excel_sep.csv": (("sep=;\r\nZeit;Weg;Kraft\r\ns;mm;N\r\n" + rows(";", ",")).encode(), {}),
        "line_break_in_names.csv": (('"Time\n(s)","Position\n(mm)","Force\n(N)"\n' + rows(",")).encode(), {}),
        "units_above_names.txt": (("s|mm|N\nTime|Position|Force\n" + rows("|")).encode(), {}),
        "old_mac_minus.csv": (
            ("time_s,position_mm,force_N\n" + rows(","))
            .replace("-", "\N{MINUS SIGN}")
            .replace("\n", "\r")
            .encode(),
            {},
        ),
        "others_beside.csv": (
            (
                "Index;Zeit ms;Sollweg mm;Weg mm;Geschwindigkeit mm/s;Kraft N\n"
                + rows(
                    ";",
                    ",",
                    (
                        np.arange(600.0),
                        1e3 * TIME,
                        POSITION + 0.1,
                        POSITION,
                        np.gradient(POSITION, TIME),
                        FORCE,
                    ),
                )
            ).encode(),
            {},
        ),
    }
