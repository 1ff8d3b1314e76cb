"""The default study: complete, labelled, repeatable; only what depends on a change runs again."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml

from running import ZIG_CACHE, copy_project, snakemake
from study_settings import artefact_paths

# Wall-clock readings differ between runs; everything else is compared byte for byte.
VOLATILE = ("logs", "benchmarks")
TWO_CHAPTERS = ("signals", "survey")


def coarse_project(folder: Path) -> Path:
    """A copy of the project whose default study is coarse."""
    copy_project(folder)
    leave_out_lighter_box(folder)
    coarse = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    coarse = coarse.replace("ZIG_CACHE", str(ZIG_CACHE))
    (folder / "config" / "coarse.yaml").write_text(coarse, encoding="utf-8")
    return folder


def leave_out_lighter_box(folder: Path) -> None:
    for path in (folder / "config" / "subjects").glob("*.yaml"):
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(line for line in lines if "box_mass_kg: 15" not in line), encoding="utf-8")


def run(folder: Path, *arguments: str, **how):
    coarse = ("--configfile", "config/coarse.yaml") if (folder / "config" / "coarse.yaml").is_file() else ()
    return snakemake(folder, *arguments, *coarse, **how)


def done(folder: Path, *arguments: str, **how):
    return run(folder, *arguments, **how).whole()


@pytest.fixture(scope="module")
def coarse_run(tmp_path_factory):
    """Folder of a project copy in which the coarse study was run with two cores."""
    folder = coarse_project(tmp_path_factory.mktemp("coarse"))
    done(folder, "--cores", "2")
    return folder


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory):
    """Folder of a project copy in which the default study was run as users run it."""
    folder = copy_project(tmp_path_factory.mktemp("default"))
    # As "make" does it.
    printed = done(folder, "--cores", "2", "--logger", "lumbar", env={"PYTHONPATH": str(folder / "workflow")})
    (folder / "printed.txt").write_text(printed.text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def chapters_run(tmp_path_factory):
    """Folder of a project copy in which two chapters of the coarse study were run."""
    folder = coarse_project(tmp_path_factory.mktemp("chapters"))
    done(folder, "--cores", "2", *TWO_CHAPTERS, "results/thesis/run_environment.json")
    return folder


@pytest.fixture(params=["chapters", pytest.param("whole", marks=pytest.mark.nightly)])
def folder(request):
    """Folder of the default study after a run of two chapters, or of all."""
    return request.getfixturevalue(f"{request.param}_run")


@pytest.fixture
def chapters(folder, chapters_run):
    """Chapters that were run in the folder, as targets; none means all."""
    return TWO_CHAPTERS if folder == chapters_run else ()


@pytest.fixture
def copy(coarse_run, tmp_path):
    """Another folder with the coarse study's results, in which its keys may be changed."""
    return shutil.copytree(coarse_run, tmp_path / "copy", symlinks=True)


def results(folder: Path, study: str = "thesis") -> Path:
    return folder / "results" / study


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.relative_to(folder).parts[0] not in VOLATILE
    }


def expected_artefacts(folder: Path, chapters: tuple[str, ...] = ()) -> list[Path]:
    run = json.loads((results(folder) / "run_environment.json").read_text(encoding="utf-8"))
    assert run["versions"]["python"]
    config = yaml.safe_load((results(folder) / "run_config.yaml").read_text(encoding="utf-8"))
    return [results(folder) / path for path in artefact_paths(config, folder, chapters)]


def test_every_artefact_is_there(folder, chapters):
    paths = expected_artefacts(folder, chapters)
    assert len(paths) > (20 if chapters else 50)
    missing = [str(path) for path in paths if not path.is_file() or path.stat().st_size == 0]
    assert not missing


def test_tables_and_figures_name_the_synthetic_twin(folder):
    drawings = {"figure_1_1", "figure_2_4", "figure_3_1", "figure_3_2"}
    unlabelled = []
    tables, figures = (
        (results(folder) / name).glob(end) for name, end in (("tables", "*"), ("figures", "*.svg"))
    )
    for path in sorted([*tables, *figures]):
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".csv" and len(text.splitlines()) == 1:
            continue  # no rows, so no data: LaTeX and HTML of the same table say it
        if path.stem not in drawings | {"table_2_1"} and "synthetic twin" not in text:
            unlabelled.append(path.name)
    assert not unlabelled


def test_tables_contain_only_finite_numbers(folder):
    for path in results(folder).rglob("*.csv"):
        text = path.read_text(encoding="utf-8").lower()
        assert not re.search(r"(^|,)-?(nan|inf)(,|$)", text, flags=re.M), path


def test_second_run_has_no_job(folder, chapters):
    assert run(folder, "--cores", "1", "--dry-run", *chapters).whole().jobs == {}


def change_mass(folder: Path, subject: str) -> None:
    path = folder / "config" / "subjects" / f"{subject}.yaml"
    text = path.read_text(encoding="utf-8")
    changed = re.sub(r"(?m)^(  mass_kg: )([\d.]+)", lambda match: f"{match[1]}{float(match[2]) + 6}", text)
    assert changed != text
    path.write_text(changed, encoding="utf-8")


@pytest.mark.nightly
def test_run_ends_with_what_was_found_in_few_lines(whole_run):
    lines = (whole_run / "printed.txt").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 40
    assert any(re.fullmatch(r"\d+ of \d+ jobs done, about .* left", line) for line in lines)
    clearest = next(line for line in lines if "error " in line)
    assert clearest.startswith("  two_hidden_effects: ") and "0.397 to 0.015 N" in clearest
    page = lines[-1].removeprefix("Open this page: ")
    assert (whole_run / page).is_file()


def test_changed_library_module_reruns_its_users(folder):
    path = min((folder / "workflow" / "lumbar" / "tissue" / "survey").glob("[!_]*.py"))
    before = path.read_text(encoding="utf-8")
    path.write_text(before + "\n# a change\n", encoding="utf-8")
    try:
        plan = done(folder, "--cores", "1", "--dry-run", *TWO_CHAPTERS)
    finally:
        path.write_text(before, encoding="utf-8")
    assert "analyse_survey" in plan.jobs
    assert "design_signals" not in plan.jobs


@pytest.mark.nightly
def test_one_core_gives_the_same_bytes_as_two(coarse_run, tmp_path):
    folder = coarse_project(tmp_path / "one_core")
    done(folder, "--cores", "1")
    first, second = digests(results(coarse_run)), digests(results(folder))
    assert len(first) > 80
    assert {name for name in first | second if first.get(name) != second.get(name)} == set()


@pytest.mark.nightly
def test_changed_mass_moves_only_basins_of_its_subject(coarse_run, copy):
    change_mass(copy, "expert")
    done(copy, "--cores", "2", "table_4_1", "table_3_1", "table_3_2")
    before, after = (pd.read_csv(results(at) / "stability" / "boa.csv") for at in (coarse_run, copy))
    # The check by cvxpy solves the programmes of all people at once: at its tolerance it moves with the others.
    keys = ["box_mass_kg", "com", "plane", "method", "sign", "time"]
    (novice, same), (expert, moved) = (
        [frame[frame.subject == name].set_index(keys).sort_index() for frame in (before, after)]
        for name in ("novice", "expert")
    )
    assert len(novice)
    columns = novice.columns.drop("sos_cvxpy_difference")
    pd.testing.assert_frame_equal(novice[columns], same[columns], check_exact=True)
    # A heavier body is slower: so few knots resolve basins of it that they did not resolve before.
    assert len(expert) > 12
    assert set(expert.index) <= set(moved.index)
    change = (expert.mean_area - moved.mean_area.loc[expert.index]).abs()
    assert (change / expert.mean_area > 1e-4).all()
    assert table(copy, "table_3_1") == table(coarse_run, "table_3_1")


def table(folder: Path, name: str) -> bytes:
    return (results(folder) / "tables" / f"{name}.csv").read_bytes()


@pytest.mark.nightly
def test_another_seed_moves_table_3_1_but_not_its_order(coarse_run, copy):
    twin = copy / "config" / "twin.yaml"
    text = twin.read_text(encoding="utf-8")
    twin.write_text(text.replace("twin:\n", "twin:\n  seed: 4711\n", 1), encoding="utf-8")
    done(copy, "--cores", "2", "table_2_1", "table_3_1", "table_3_2")
    for unmoved in ("table_2_1", "table_3_2"):
        assert table(copy, unmoved) == table(coarse_run, unmoved)
    wide = []
    for frame in (pd.read_csv(results(at) / "tables" / "table_3_1.csv") for at in (coarse_run, copy)):
        arx = frame[(frame.estimator == "arx") & frame.model.isin(["MW", "KB", "HO"])]
        wide.append(arx.pivot(index="trained_on", columns="model", values="vaf_percent"))
    assert (wide[0] != wide[1]).all(axis=None)
    for shares in wide:
        assert (shares.MW < shares.KB - 30).all()
        assert (shares.KB < shares.HO).all()


@pytest.mark.nightly
def test_report_contains_every_artefact_and_no_external_link(whole_run):
    done(whole_run, "--cores", "1", "report")
    text = (results(whole_run) / "report.html").read_text(encoding="utf-8")
    links = set(re.findall(r'href="([^"#]+)"', text))
    assert {str(path.relative_to(results(whole_run))) for path in expected_artefacts(whole_run)} <= links
    assert '<p class="verdict-no">' not in text
    assert not re.search(r'(src|href)="https?:', text)
    assert len(text) < 3e6
