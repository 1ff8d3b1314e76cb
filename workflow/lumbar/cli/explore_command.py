"""``lumbar explore``: the page of a diagnosis, served on this machine."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.cli.options import add_data, add_fit, new_command
from lumbar.errors import InputError

if TYPE_CHECKING:
    from lumbar.config.study import Study
    from lumbar.interface.diagnosis import Diagnosis
    from lumbar.page_server.explored_set import ExploredSet


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
        "--output", type=Path, default=Path("explored"), metavar="DIR", help="folder that the page writes to"
    )
    add_fit(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Serve the page until it is interrupted."""
    from lumbar.page_server.server import new_server

    folder = options.target is not None and options.target.is_dir()
    sets = [_of_folder(options)] if folder else _of_study(options)
    server = new_server(sets, options.port)
    server.start()
    for explored in sets:
        print(f"http://127.0.0.1:{server.port}/{explored.name}", flush=True)
    print("Ctrl-C ends it.", flush=True)
    if not options.no_browser:
        server.io_loop.add_callback(server.show, f"/{sets[0].name}")
    server.io_loop.start()


def _of_folder(options) -> ExploredSet:
    from lumbar.cli.record_folder import read_folder
    from lumbar.interface.diagnosis import diagnose
    from lumbar.page_server.explored_set import ExploredSet

    options.folder = options.target
    settings, records, chosen = read_folder(options)
    gravity = settings.stability.pendulum.gravity_m_s2
    machine, tissue = settings.signals.machine, settings.tissue
    make = partial(diagnose, records, machine=machine, tissue=tissue, gravity_m_s2=gravity, **chosen)
    return ExploredSet("records", make, options.output)


def _of_study(options) -> list[ExploredSet]:
    from lumbar.config.load_study import DEFAULT_FILES, load_study_file
    from lumbar.page_server.explored_set import ExploredSet

    if not DEFAULT_FILES[0].is_file():
        raise InputError(
            f"{options.target or DEFAULT_FILES[0]}: no folder of records, and here is no project whose study it could be "
            f"({DEFAULT_FILES[0]}): go to the project's folder, or name a folder of records"
        )
    study = load_study_file(Path(), options.target)
    file = options.target or DEFAULT_FILES[0]
    return [
        ExploredSet(
            entry.name,
            partial(_diagnosed, study, entry.name),
            options.output / study.name / entry.name,
            None if entry.records else file,
        )
        for entry in study.settings.improvement.record_sets
    ]


def _diagnosed(study: Study, name: str) -> Diagnosis:
    """Diagnose one record set as the workflow does."""
    from lumbar.config.study_recordings import record_layout, record_set
    from lumbar.interface.diagnosis import diagnose
    from lumbar.interface.reading import read_listed

    settings, entry = study.settings, record_set(study.settings, name)
    layout, rate = record_layout(settings, entry.base)
    paths = [study.recording(record.file) for record in entry.records]
    missing = [path for path in paths if not Path(path).is_file()]
    if missing:
        made = "; 'snakemake' makes the synthetic twin's recordings" if study.synthetic else ""
        raise InputError(f"{', '.join(missing)}: not there{made}")
    return diagnose(
        read_listed(paths, entry.records, layout, rate),
        base=entry.base,
        session=entry.session,
        settings=settings.improvement,
        machine=settings.signals.machine,
        tissue=settings.tissue,
        gravity_m_s2=settings.stability.pendulum.gravity_m_s2,
        seed=settings.seed,
        data=study.data_label,
    )
