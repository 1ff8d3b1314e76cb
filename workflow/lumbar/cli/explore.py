"""``lumbar explore``: the pages of diagnoses and of lifts, served on this machine."""

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

import lumbar
from lumbar.base.errors import InputError
from lumbar.cli.command import read_settings
from lumbar.cli.tissue import fit_arguments, fit_settings
from lumbar.interface.lift_page import saved_lifts
from lumbar.interface.reading import read_listed
from lumbar.page_server.background import WRITING
from lumbar.page_server.index import INDEX, Index
from lumbar.page_server.own_recordings import UploadDiagnosis
from lumbar.page_server.served_sets import OWN, ExploredSet, ServedLift, ServedSets, StoredVerdict
from lumbar.page_server.server import new_server
from lumbar.records.record import Record
from lumbar.settings.study_settings import StudySettings
from lumbar.study.load_study import DEFAULT_FILES, load_study_file
from lumbar.study.study import Study, record_set, set_layout, settings_of_set
from lumbar.twin.examples import example_records

EXPLORED = Path("explored")


def run_explore(options) -> None:
    """Serve the pages until interrupted."""
    options.output = options.output and options.output.resolve()  # the given path may be a link
    index, own = _index(options)
    server, visitors = new_server(index, options.port, own)
    server.start()
    addresses = {INDEX: "all pages"}
    addresses |= {address: f"what is missing in {item.title}" for address, item in index.sets.named.items()}
    addresses |= {item.address: f"lift {item.name}" for item in index.lifts}
    addresses |= {OWN: "your own files, dropped on the page"}
    for address, words in sorted(addresses.items(), key=lambda item: item[0] != index.first):
        print(f"{visitors.address(address)}  {words}", flush=True)
    print("Anyone with an address may use its page; Ctrl-C ends it.", flush=True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    opened = nullcontext() if options.no_browser else _open_in_browser(visitors.address(index.first))
    try:
        with opened:
            server.io_loop.start()
    finally:
        WRITING.acquire()  # files in work are completed


@contextmanager
def _open_in_browser(address: str) -> Iterator[None]:
    """Open an address with a token by a file that redirects to it: other accounts see a program's arguments.

    The file is in the home folder, since some browsers may read nothing else.
    """
    home = Path.home() if os.access(Path.home(), os.W_OK) else None
    with TemporaryDirectory(prefix="lumbar-", dir=home) as folder:  # readable by its owner only
        page = Path(folder) / "open.html"
        page.write_text(
            f'<meta http-equiv="refresh" content="0; url={html.escape(address)}">', encoding="utf-8"
        )
        webbrowser.open(page.as_uri())
        yield


def _index(options) -> tuple[Index, UploadDiagnosis]:
    """Return the index of the study or folder in the options, and the diagnosis of the user's recordings."""
    target, results, lifts, first = options.target, None, [], INDEX
    output = options.output or EXPLORED
    records = example_records()
    make = partial(lumbar.diagnose, records, settings=fit_settings(options), source_label="synthetic example")
    title = "an example to try"
    example = ExploredSet("_example", make, output / "example", title=title, read_first=lambda: records[0])
    if target is None and not DEFAULT_FILES[0].is_file():
        place, sets, settings = "Your own recordings", [], fit_settings(options)
    elif target is None or not target.is_dir():
        study, sets = _study_sets(options)
        place, results, lifts = study.name, Path("results") / study.name, _lifts_of_study(study)
        settings, output = study.settings, output / study.name
    elif (target / "run_config.yaml").is_file() or saved_lifts(target):
        place, results = target.resolve().name, target if (target / "run_config.yaml").is_file() else None
        folders = [page.parent for page in sorted(target.glob("improvement/*/diagnosis.html"))]
        sets = [ExploredSet(folder.name, None, EXPLORED, stored=StoredVerdict(folder)) for folder in folders]
        settings, stability = fit_settings(options), read_settings(options).stability
        lifts = [ServedLift(folder, stability, options.data) for folder in saved_lifts(target)]
    else:
        options.folder, place = target, target.resolve().name
        fit = fit_arguments(options)
        settings, folder = fit["settings"], options.output or EXPLORED / place  # one folder per target
        make, read = partial(lumbar.diagnose, **fit), lambda: fit["records"][0]
        sets = [ExploredSet("records", make, folder, title=str(target), read_first=read)]
        first = f"/{sets[0].name}"
    # Each of the user's files is an experiment, not a part of one session.
    improvement = settings.improvement.model_copy(update={"session": False})
    settings = settings.model_copy(update={"improvement": improvement})
    upload = UploadDiagnosis(partial(lumbar.diagnose, settings=settings), output / "own")
    return Index(place, ServedSets([*sets, example]), lifts, results, first), upload


def _study_sets(options) -> tuple[Study, list[ExploredSet]]:
    """Return the study and its record sets, diagnosed as in the workflow."""
    if not DEFAULT_FILES[0].is_file():
        raise InputError(
            f"{options.target} is neither a folder of records nor a study of a project ({DEFAULT_FILES[0]} is missing). Go to "
            "the project's folder, name a folder of records, or name none and give files on the page."
        )
    study = load_study_file(Path(), options.target, trust=options.trust)
    sets = []
    for name in (entry.name for entry in study.settings.improvement.record_sets):
        paths = [study.recording(record.file) for record in record_set(study.settings, name).records]
        stored = StoredVerdict(
            Path("results") / study.name / "improvement" / name,
            study.settings.model_dump(mode="json"),
            [*map(Path, paths), options.target or DEFAULT_FILES[0], *DEFAULT_FILES],
        )
        output = (options.output or EXPLORED) / study.name / name
        make, read = partial(_diagnose_set, study, name, paths), None
        if Path(paths[0]).is_file():
            read = partial(_read_first, study, name, paths)
        sets.append(ExploredSet(name, make, output, stored=stored, read_first=read))
    return study, sets


def _read_first(study: Study, name: str, paths: list[str]) -> Record:
    """Return the first record of a set."""
    entry = record_set(study.settings, name)
    return read_listed(paths[:1], entry.records[:1], *set_layout(study.settings, name))[0]


def _diagnose_set(study: Study, name: str, paths: list[str]):
    missing = [path for path in paths if not Path(path).is_file()]
    if missing:
        made = "; 'snakemake' makes the synthetic twin's recordings" if study.synthetic else ""
        raise InputError(f"{', '.join(missing)}: not there{made}")
    entry = record_set(study.settings, name)
    records: Sequence[Record] = read_listed(paths, entry.records, *set_layout(study.settings, name))
    settings: StudySettings = settings_of_set(study.settings, name)
    return lumbar.diagnose(records, settings=settings, source_label=study.data_label)


def _lifts_of_study(study: Study) -> list[ServedLift]:
    """Return the lifts of a study that have results; print the number of the others to standard error."""
    made = [path for path in saved_lifts(Path("results") / study.name) if path.name in study.lifts]
    absent = len(study.lifts) - len(made)
    if absent:
        print(
            f"{absent} of {len(study.lifts)} lifts are not there yet: 'snakemake lifting' makes them",
            file=sys.stderr,
        )
    return [ServedLift(path, study.settings.stability, study.data_label) for path in made]
