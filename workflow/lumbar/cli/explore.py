"""``lumbar explore``: the pages of diagnoses and of lifts, served on this machine."""

from __future__ import annotations

import html
import os
import signal
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError
from lumbar.cli.options import given_settings
from lumbar.cli.tissue import fit_settings, read_folder

if TYPE_CHECKING:
    from lumbar.interface.diagnosed import Diagnosis
    from lumbar.page_server.index import Index
    from lumbar.page_server.own_recordings import OwnDiagnosis
    from lumbar.page_server.served_sets import ExploredSet, ServedLift
    from lumbar.records.record import Record
    from lumbar.settings.study_settings import StudySettings
    from lumbar.study.study import Study

EXPLORED = Path("explored")


def run_explore(options) -> None:
    """Serve the page until it is interrupted."""
    from lumbar.page_server.background import WRITING
    from lumbar.page_server.index import INDEX
    from lumbar.page_server.served_sets import OWN
    from lumbar.page_server.server import new_server

    options.output = options.output and options.output.resolve()  # what a person names may be a link
    index, own, first = _what_is_shown(options)
    server, visitors = new_server(index, options.port, own)
    server.start()
    addresses = {INDEX: "all pages"}
    addresses |= {address: f"what is missing in {item.words}" for address, item in index.sets.given.items()}
    addresses |= {item.address: f"lift {item.folder.absolute().name}" for item in index.lifts}
    addresses |= {OWN: "your own files, dropped on the page"}
    for address, words in sorted(addresses.items(), key=lambda item: item[0] != first):
        print(f"{visitors.address(address)}  {words}", flush=True)
    print("Whoever has an address may do all that the page does; Ctrl-C ends it.", flush=True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    opened = nullcontext() if options.no_browser else _in_browser(visitors.address(first))
    try:
        with opened:
            server.io_loop.start()
    finally:
        WRITING.acquire()  # what is being written is written whole


@contextmanager
def _in_browser(address: str) -> Iterator[None]:
    """Open an address with a token. The browser is given a file that leads there: other accounts see what a program is given.

    The file lies in the home folder, which browsers may read where they may read nothing else.
    """
    home = Path.home() if os.access(Path.home(), os.W_OK) else None
    with TemporaryDirectory(prefix="lumbar-", dir=home) as folder:  # for its owner's eyes alone
        page = Path(folder) / "open.html"
        page.write_text(
            f'<meta http-equiv="refresh" content="0; url={html.escape(address)}">', encoding="utf-8"
        )
        webbrowser.open(page.as_uri())
        yield


def _what_is_shown(options) -> tuple[Index, OwnDiagnosis, str]:
    """The index, how own recordings are diagnosed, and the address that is opened first."""
    from lumbar.interface.lift_page import saved_lifts
    from lumbar.page_server.index import INDEX, Index
    from lumbar.page_server.served_sets import ServedLift, ServedSets
    from lumbar.study.load_study import DEFAULT_FILES

    target, results, lifts = options.target, None, []
    if target is None and not DEFAULT_FILES[0].is_file():
        place, sets, own = "Your own recordings", [], _own(fit_settings(options), options.output or EXPLORED)
    elif target is None or not target.is_dir():
        study, sets, own = _of_study(options)
        place, results, lifts = study.name, Path("results") / study.name, _lifts_of_study(study)
    elif (target / "run_config.yaml").is_file() or saved_lifts(target):
        place, results = target.resolve().name, target if (target / "run_config.yaml").is_file() else None
        sets, own = _of_results(options), _own(fit_settings(options), options.output or EXPLORED)
        settings = given_settings(options).stability
        lifts = [ServedLift(folder, settings, options.data) for folder in saved_lifts(target)]
    else:
        place, (sets, own) = target.resolve().name, _of_folder(options)
        return Index(place, ServedSets([*sets, _example(options)])), own, f"/{sets[0].name}"
    return Index(place, ServedSets([*sets, _example(options)]), lifts, results), own, INDEX


def _example(options) -> ExploredSet:
    """Records in which something is hidden, for whoever has none."""
    from lumbar.interface.diagnosis import diagnose
    from lumbar.page_server.served_sets import ExploredSet
    from lumbar.twin.examples import example_records

    make = partial(
        diagnose, example_records(), settings=fit_settings(options), source_label="synthetic example"
    )
    output = (options.output or EXPLORED) / "example"
    return ExploredSet("_example", make, output, title="an example to try")


def _of_results(options) -> list[ExploredSet]:
    """Verdicts in the results of a study, as they stand."""
    from lumbar.page_server.served_sets import ExploredSet, StoredVerdict

    folders = [page.parent for page in sorted(options.target.glob("improvement/*/diagnosis.html"))]
    return [ExploredSet(folder.name, None, EXPLORED, stored=StoredVerdict(folder)) for folder in folders]


def _of_folder(options) -> tuple[list[ExploredSet], OwnDiagnosis]:
    from lumbar.interface.diagnosis import diagnose
    from lumbar.page_server.served_sets import ExploredSet

    options.folder = options.target
    records, settings, data = read_folder(options)
    output = options.output or EXPLORED / options.folder.resolve().name  # two folders, two places
    explored = ExploredSet(
        "records",
        partial(diagnose, records, settings=settings, source_label=data),
        output,
        title=str(options.folder),
    )
    return [explored], _own(settings, options.output or EXPLORED)


def _own(settings: StudySettings, output: Path) -> OwnDiagnosis:
    """How a person's own files are diagnosed: each is taken for an experiment of its own."""
    from lumbar.interface.diagnosis import diagnose
    from lumbar.page_server.own_recordings import OwnDiagnosis

    alone = settings.model_copy(
        update={"improvement": settings.improvement.model_copy(update={"session": False})}
    )
    return OwnDiagnosis(partial(diagnose, settings=alone), output / "own")


def _of_study(options) -> tuple[Study, list[ExploredSet], OwnDiagnosis]:
    from lumbar.study.load_study import DEFAULT_FILES, load_study_file

    if not DEFAULT_FILES[0].is_file():
        raise InputError(
            f"{options.target}: no folder of records, and here is no project whose study it could be "
            f"({DEFAULT_FILES[0]}): go to the project's folder, name a folder of records, or none and give files on the page"
        )
    study = load_study_file(Path(), options.target, trust=options.trust)
    file = options.target or DEFAULT_FILES[0]
    output = (options.output or EXPLORED) / study.name
    sets = [
        _of_set(study, entry.name, file, output / entry.name)
        for entry in study.settings.improvement.record_sets
    ]
    return study, sets, _own(study.settings, output)


def _of_set(study: Study, name: str, file: Path, output: Path) -> ExploredSet:
    """A record set, diagnosed as the workflow does."""
    from lumbar.interface.diagnosis import diagnose
    from lumbar.page_server.served_sets import ExploredSet, StoredVerdict
    from lumbar.study.load_study import DEFAULT_FILES
    from lumbar.study.study import settings_of_set

    def diagnosed() -> Diagnosis:
        return diagnose(
            _records_of(study, name),
            settings=settings_of_set(study.settings, name),
            source_label=study.data_label,
        )

    stored = StoredVerdict(
        Path("results") / study.name / "improvement" / name,
        study.settings.model_dump(mode="json"),
        [*map(Path, _paths_of(study, name)), file, *DEFAULT_FILES],
    )
    return ExploredSet(name, diagnosed, output, stored=stored)


def _paths_of(study: Study, name: str) -> list[str]:
    from lumbar.study.study import record_set

    return [study.recording(record.file) for record in record_set(study.settings, name).records]


def _records_of(study: Study, name: str) -> Sequence[Record]:
    from lumbar.interface.reading import read_listed
    from lumbar.study.study import record_set, set_layout

    entry, paths = record_set(study.settings, name), _paths_of(study, name)
    missing = [path for path in paths if not Path(path).is_file()]
    if missing:
        made = "; 'snakemake' makes the synthetic twin's recordings" if study.synthetic else ""
        raise InputError(f"{', '.join(missing)}: not there{made}")
    return read_listed(paths, entry.records, *set_layout(study.settings, name))


def _lifts_of_study(study: Study) -> list[ServedLift]:
    """Lifts of a study, as far as they are made; the others are counted on standard error."""
    from lumbar.interface.lift_page import saved_lifts
    from lumbar.page_server.served_sets import ServedLift

    made = [path for path in saved_lifts(Path("results") / study.name) if path.name in study.lifts]
    absent = len(study.lifts) - len(made)
    if absent:
        print(
            f"{absent} of {len(study.lifts)} lifts are not there yet: 'snakemake lifting' makes them",
            file=sys.stderr,
        )
    return [ServedLift(path, study.settings.stability, study.data_label) for path in made]
