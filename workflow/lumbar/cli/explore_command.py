"""``lumbar explore``: the page of a diagnosis, served on this machine."""

from __future__ import annotations

import signal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.cli.options import add_data, add_fit, new_command
from lumbar.errors import InputError

if TYPE_CHECKING:
    from lumbar.config.study import Study
    from lumbar.interface.diagnosis import Diagnosis
    from lumbar.page_server.explored_set import ExploredSet
    from lumbar.page_server.own_recordings import OwnDiagnosis

EXPLORED = Path("explored")


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "explore",
        "look at diagnoses in the browser: compare models with records, add effects, write what was chosen",
        "lumbar explore recordings/tissue\n  lumbar explore config/studies/davinci_tool.yaml\n  lumbar explore",
    )
    parser.add_argument(
        "target",
        type=Path,
        nargs="?",
        metavar="STUDY|FOLDER",
        help="file of a study, or folder of records (default: the study of config/config.yaml)",
    )
    parser.add_argument("--port", type=int, default=5006, metavar="N", help="port (default 5006)")
    parser.add_argument("--no-browser", action="store_true", help="open no browser, print the address")
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="folder that the page writes to (default: below explored/)"
    )
    add_fit(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Serve the page until it is interrupted."""
    from lumbar.page_server.background import WRITING
    from lumbar.page_server.served_sets import OWN
    from lumbar.page_server.server import new_server

    folder = options.target is not None and options.target.is_dir()
    sets, own = _of_folder(options) if folder else _of_study(options)
    server = new_server(sets, options.port, own)
    server.start()
    for address in (*(explored.name for explored in sets), OWN.removeprefix("/")):
        print(f"http://127.0.0.1:{server.port}/{address}", flush=True)
    print("Ctrl-C ends it.", flush=True)
    if not options.no_browser:
        server.io_loop.add_callback(server.show, f"/{sets[0].name}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        server.io_loop.start()
    finally:
        WRITING.acquire()  # what is being written is written whole


def _of_folder(options) -> tuple[list[ExploredSet], OwnDiagnosis]:
    from lumbar.cli.record_folder import read_folder
    from lumbar.interface.diagnosis import diagnose
    from lumbar.page_server.explored_set import ExploredSet
    from lumbar.page_server.own_recordings import OwnDiagnosis

    options.folder = options.target
    settings, records, chosen = read_folder(options)
    gravity = settings.stability.pendulum.gravity_m_s2
    fixed = partial(diagnose, machine=settings.signals.machine, gravity_m_s2=gravity)
    output = options.output or EXPLORED / options.folder.resolve().name  # two folders, two places
    own = {key: chosen[key] for key in ("base", "forward", "session", "settings", "seed")}
    return [ExploredSet("records", partial(fixed, records, **chosen), output)], OwnDiagnosis(
        partial(fixed, **own), (options.output or EXPLORED) / "own"
    )


def _of_study(options) -> tuple[list[ExploredSet], OwnDiagnosis]:
    from lumbar.config.load_study import DEFAULT_FILES, load_study_file
    from lumbar.page_server.explored_set import ExploredSet
    from lumbar.page_server.kept_effects import keep_effects
    from lumbar.page_server.kept_records import keep_records
    from lumbar.page_server.own_recordings import OwnDiagnosis

    if not DEFAULT_FILES[0].is_file():
        raise InputError(
            f"{options.target or DEFAULT_FILES[0]}: no folder of records, and here is no project whose study it could be "
            f"({DEFAULT_FILES[0]}): go to the project's folder, or name a folder of records"
        )
    study = load_study_file(Path(), options.target)
    file = options.target or DEFAULT_FILES[0]
    output = (options.output or EXPLORED) / study.name
    sets = [
        ExploredSet(
            entry.name,
            partial(_diagnosed, study, entry.name),
            output / entry.name,
            partial(keep_effects, file, study.settings, entry.name),
            file.name,
        )
        for entry in study.settings.improvement.record_sets
    ]
    return sets, OwnDiagnosis(
        partial(_diagnose_as, study), output / "own", partial(keep_records, file, study), file.name
    )


def _diagnosed(study: Study, name: str) -> Diagnosis:
    """Diagnose one record set as the workflow does."""
    from lumbar.config.study_recordings import record_set, set_layout
    from lumbar.interface.reading import read_listed

    entry = record_set(study.settings, name)
    paths = [study.recording(record.file) for record in entry.records]
    missing = [path for path in paths if not Path(path).is_file()]
    if missing:
        made = "; 'snakemake' makes the synthetic twin's recordings" if study.synthetic else ""
        raise InputError(f"{', '.join(missing)}: not there{made}")
    records = read_listed(paths, entry.records, *set_layout(study.settings, name))
    fitted = {"base": entry.base, "train": entry.train, "session": entry.session}
    return _diagnose_as(study, records, **fitted, data=study.data_label)


def _diagnose_as(study: Study, records, **chosen) -> Diagnosis:
    """Diagnose records by the study's settings."""
    from lumbar.interface.diagnosis import diagnose

    settings = study.settings
    return diagnose(
        records,
        settings=settings.improvement,
        machine=settings.signals.machine,
        gravity_m_s2=settings.stability.pendulum.gravity_m_s2,
        seed=settings.seed,
        **chosen,
    )
