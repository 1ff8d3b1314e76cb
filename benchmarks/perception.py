"""What a hand can tell: the thresholds, pairs of forces of which the answer is known, and the rate of training and playing.

    python benchmarks/perception.py [--markdown docs/tissue/perception.md]

Pairs are one force of a sine of 0.7 Hz, 2 to 6 N, and another with a gain, dry friction, a delay or a hum. The rates are those of
the study's synthetic tissue, recorded a thousand times a second with the signals of ``results/thesis/signals``; the default
study's table ``rates`` has the records' own 100 Hz. With ``--markdown`` the tables go into that page.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from one_thread import PROJECT  # isort: skip

import numpy as np
import pandas as pd
from scipy.signal import resample

from acceptance_page import show_section
from lumbar.records.record import Channel, Record
from lumbar.settings.runtime import RuntimeSettings
from lumbar.study.load_study import load_settings
from lumbar.tissue.haptics.rates import RATES_HZ, rates, rates_table
from lumbar.tissue.perception.felt import Difference, Felt
from lumbar.tissue.perception.thresholds import Hands, thresholds_table
from lumbar.twin.tissue_recordings import tissue_test

RATE = 1000.0


def pairs() -> dict[str, Felt]:
    """Differences of known size, each beside the same force."""
    time = np.arange(0, 20, 1 / RATE)
    position = 5 * np.sin(2 * np.pi * 0.7 * time)
    force = 4 + 0.4 * position
    differences = {f"gain +{percent} %": percent / 100 * force for percent in (5, 10, 20)}
    differences |= {
        f"dry friction of {size:g} N": size * np.sign(np.gradient(position)) for size in (0.1, 0.3, 1.0)
    }
    differences |= {
        f"delay of {1e3 * delay:g} ms": np.interp(time - delay, time, force) - force
        for delay in (0.005, 0.036)
    }
    differences |= {
        f"hum of {amplitude:g} N at {hertz} Hz": amplitude * np.sin(2 * np.pi * hertz * time)
        for hertz in (8, 200)
        for amplitude in (0.05, 0.5)
    }
    hands = Hands.of()
    return {
        name: Difference(force, item, position, 1 / RATE, hands).felt for name, item in differences.items()
    }


def fast_records(results: Path) -> tuple[list[Record], object]:
    """The study's synthetic tissue tests, recorded a thousand times a second, and the study's settings."""
    settings = load_settings(PROJECT / "config" / "config.yaml", PROJECT / "config" / "twin.yaml")
    found = []
    for number, name in enumerate(("multisine", "noise", "chirp")):
        played = pd.read_csv(results / "signals" / f"{name}.csv")["position_mm"].to_numpy()
        position = resample(played, 10 * len(played))
        time = np.arange(len(position)) / RATE
        force = tissue_test(time, position, settings.twin.tissue, settings.twin.seed, number)
        channels = {
            "input": Channel(position, "position", "mm"),
            "output": Channel(force, "force", "N"),
        }
        found.append(Record(name, time, channels))
    return found, settings


def lines_of(frame: pd.DataFrame) -> list[str]:
    """A table in Markdown."""
    rows = [list(frame.columns), ["---"] * frame.shape[1], *frame.astype(str).to_numpy().tolist()]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]


def report(results: Path) -> list[str]:
    """Thresholds, pairs and rates as lines of Markdown."""
    literature = thresholds_table().frame[["quantity", "found", "range", "task", "key", "source", "read"]]
    made = pd.DataFrame(
        {
            "difference": name,
            "felt (JND)": f"{item.jnd.value:.2f} ({item.jnd.low:.2f} to {item.jnd.high:.2f})",
            "slow, fast": f"{item.slow.value:.2f}, {item.fast.value:.2f}",
            "felt of the time": f"{item.time_percent.value:.0f} %",
            "told apart": f"{item.told_apart_percent.value:.0f} % ({item.told_apart_percent.low:.0f} to "
            f"{item.told_apart_percent.high:.0f})",
        }
        for name, item in pairs().items()
    )
    records, settings = fast_records(results)
    tissue = replace(settings.tissue, search=replace(settings.tissue.search, order_max=4))
    found = list(
        rates(records[0], records[1:], tissue, RuntimeSettings(estimator="output_error"), Hands.of())
    )
    table = rates_table(found, "multisine", "synthetic twin").frame
    own = table[(table["model"] == "KB") & table["played_Hz"].isin(RATES_HZ)]
    rows = pd.DataFrame(
        {
            "trained (Hz)": own["trained_Hz"].map("{:g}".format),
            "played (Hz)": own["played_Hz"].map("{:g}".format),
            "%VAF": own["vaf_percent"].map("{:.2f}".format),
            "stiffness at 1 Hz (N/mm)": own["stiffness"].map("{:.3f}".format),
            "stable up to (N/mm)": own["stable_stiffness"].map("{:.3g}".format),
            "felt against 1000 Hz (JND)": [
                f"{row.felt_jnd:.2f} ({row.felt_low:.2f} to {row.felt_high:.2f})" for row in own.itertuples()
            ],
        }
    )
    parts = [lines_of(literature), lines_of(made), lines_of(rows)]
    heads = (
        "Thresholds",
        "Pairs with a known answer",
        "KB by output error, trained and played at several rates",
    )
    return [line for head, part in zip(heads, parts, strict=True) for line in (f"**{head}**", "", *part, "")][
        :-1
    ]


def main() -> None:
    """Print the tables, and write them into a page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, default=PROJECT / "results" / "thesis")
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    show_section(options.markdown, "what a hand tells", report(options.results))


if __name__ == "__main__":
    main()
