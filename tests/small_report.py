"""A small study's results, made by hand, and its report: tables wider than a page, pictures, warnings, claims."""

from pathlib import Path

import pandas as pd

from lumbar.base.files import write_json, write_text
from lumbar.publishing.figures.style import new_figure, save
from lumbar.publishing.study_report.contents import chapters
from lumbar.publishing.study_report.report_page import report_page
from lumbar.study.study import Artefact
from lumbar.tables.table import Table

SHEET = [
    Artefact(*row.split("|"))
    for row in (
        "table_3_1|tissue_models|tables/table_3_1.{csv,tex,html}|tissue|Table 3.1|Eq. 3.12|lumbar.identify",
        "models|tissue_models|tissue/models.json|tissue",
        "ladders|diagnose|improvement/{record_set}/ladder.{svg,pdf}|improvement|Ladder of {record_set}",
        "diagnoses|diagnose|improvement/{record_set}/diagnosis.{json,html}|improvement|Diagnosis of {record_set}",
        "events|lifting_figures|figures/events_{lift}.{svg,pdf}|lifting|Events: {lift}|Section 4.2|lumbar.lift",
        "basins|stability_tables|tables/basins.{csv,tex,html}|stability|Basins <of> attraction",
    )
]
CHOICES = {
    "lift": {"a_1kg": "a, box of 1 kg", "b_2kg": "b, box of 2 kg"},
    "record_set": {"one": "one", "two": "two"},
}
CLAIMS = pd.DataFrame(
    [
        ("best", "3.2.5", "HO is best", "HO", "KB 80", "does not hold", "for all", "table_3_1"),
        ("loops", "3.2.5", "It is stable", "yes", "all stable", "holds", "poles", "models"),
        ("table_3_1.noise.KB.vaf_percent", "Table 3.1", "KB: %VAF", 66.16, 80.214, "does not hold", "within 10", "table_3_1"),
        ("table_3_1.noise.KB.order", "Table 3.1", "KB: order", 1.0, 1.0, "holds", "within 1", "table_3_1"),
        ("table_3_1.noise.HO.order", "Table 3.1", "HO: order", 4.0, None, "cannot be tested on this data", "", "table_3_1"),
    ],
    columns=["claim", "location", "statement", "thesis_value", "this_run", "verdict", "criterion", "evidence"],
)  # fmt: skip


def make_results(folder: Path) -> Path:
    """Write the results of all artefacts but ``basins``; return their folder."""
    results = folder / "results" / "small"
    for name in ("tables", "figures", "captions", "tissue", "logs/export", "checked", "stability"):
        (results / name).mkdir(parents=True)
    names = [
        "trained_on",
        "model",
        "vaf_percent",
        *(f"long_name_of_a_measure_{number}_mm" for number in range(24)),
    ]
    frame = pd.DataFrame({name: [10.0**row for row in range(-4, 4)] for name in names})
    frame["trained_on"] = "noise"
    for number in range(7):
        frame[f"remark_{number}"] = "an explanation of inhomogeneously distributed words " * 3
    names = list(frame.columns)
    Table("Table 3.1: errors.", frame, dict.fromkeys(names, "a word"), "synthetic twin").write(
        results / "tables" / "table_3_1"
    )
    for path, who in (
        ("improvement/one/ladder", ""), ("improvement/two/ladder", ""),
        ("figures/events_a_1kg", "a, box of 1 kg"), ("figures/events_b_2kg", "b, box of 2 kg"),
    ):  # fmt: skip
        (results / path).parent.mkdir(parents=True, exist_ok=True)
        figure, axis = new_figure(7.2, 2.0)
        axis.plot([0, 1 / 3], [0, 2 / 3])
        save(figure, results / path, "synthetic twin", who=who)
    write_json(results / "tissue" / "models.json", {})
    for name, verdict, floor in (("one", "named", 0.1), ("two", "unexplained", None)):
        ladder = [{"effects": [], "test_rms": 0.4}, {"effects": ["inertia"], "test_rms": 0.1234}]
        document = {"base": "KB", "train": "noise", "unit": "N", "verdict": verdict, "complete": True}
        document |= {"selected": ["inertia"], "tied_with": [], "ladder": ladder, "noise_floor_rms": floor}
        document |= {"headline": f"The KB model lacks inertia in {name}."}
        document |= {"findings": [{"sentence": "Clock & sign."}]}
        write_json(results / "improvement" / name / "diagnosis.json", document)
        write_text(results / "improvement" / name / "diagnosis.html", "<p>page</p>")
    log = "FMUs: 1 of 2\nWARNING: not safe:\n  MW is unstable\n  raise the rate\ndone\n"
    write_text(results / "logs" / "export" / "fmu.log", log)
    warning = "WARNING: a_6kg has no pendulum:\n  its file says why\n"
    write_text(results / "logs" / "lift" / "a_6kg.log", warning)
    entry = {"file": "noise.csv", "name": "noise", "rate_Hz": 100.0, "duration_s": 10.0}
    channels = {"input": {"quantity": "position", "unit": "mm"}}
    write_json(results / "checked" / "tissue.json", {"recordings": [entry | {"channels": channels}]})
    write_text(
        results / "stability" / "failures.csv",
        "subject,experience,box_mass_kg,com,plane,basin,reason\na,b,1,thorax,lateral_bending,exact,ρ is negative\n",
    )
    files = {"file": ["KB_fmi3.fmu", "MW_fmi3.fmu"], "schema_problems": [2, 0], "relative_error": [0.0, 3e-6]}
    checks = pd.DataFrame(files)
    write_text(results / "runtime" / "fmu_check.csv", checks.assign(tolerance=1e-12).to_csv(index=False))
    for row in SHEET:
        write_text(results / "captions" / f"{row.id}.rst", f"Caption of {row.id} & *what* it shows.")
    return results


def page_of(results: Path) -> str:
    """Return the report of `make_results`."""
    made = chapters(results, results / "captions", SHEET, CHOICES, CLAIMS)
    facts = {"name": "small", "title": "A small study", "source_label": "synthetic twin", "seed": 1}
    facts |= {"people": ["a, box of 1 kg"], "versions": {"python": "3"}}
    return report_page(facts, results, made, CLAIMS)
