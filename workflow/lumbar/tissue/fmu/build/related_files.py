"""What says to other programs which files of an FMU are stimulus, reference result and experiment: FMI-LS-REF.

FMI Layered Standard References, 1.0.0-beta.1, and the experiments format of the Modelica Association that it names; both are
drafts, and nobody needs them to play the FMU.
"""

from __future__ import annotations

import hashlib

from lumbar.base.templates import template
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.conventions import (
    EXPERIMENTS,
    LAYERED_STANDARD,
    MANIFEST,
    REFERENCE,
    ROLES,
    WITHOUT_EVENT_MODE,
)

_TO_THE_TOP = "../../"
"""From the folder of the layered standard."""
_TYPES = {".csv": "text/csv", ".exp": "application/x-ma-hs-experiments"}


def related_files(model: ExportModel, signals: dict[str, str]) -> dict[str, str]:
    """Return manifest, experiments and words on both by their paths in the FMU.

    Parameters
    ----------
    signals : dict of str to str
        Reference signals by their paths: `lumbar.tissue.fmu.build.package.resources`.
    """
    experiments = _experiments(model, signals)
    related = {**signals, EXPERIMENTS: experiments}
    files = [
        {
            "source": _source(path),
            "type": _TYPES[path[path.rindex(".") :]],
            "checksum": hashlib.sha3_256(text.encode()).hexdigest(),
            **dict(zip(("label", "role", "description"), ROLES[path], strict=True)),
        }
        for path, text in related.items()
    ]
    manifest = template("tissue/fmu/build/manifest.xml.jinja").render(
        files=files, name=LAYERED_STANDARD, version="1.0.0-beta.1"
    )
    return {MANIFEST: manifest, EXPERIMENTS: experiments}


def _source(path: str) -> str:
    folder = MANIFEST[: MANIFEST.rindex("/") + 1]
    return path.removeprefix(folder) if path.startswith(folder) else _TO_THE_TOP + path


def _experiments(model: ExportModel, signals: dict[str, str]) -> str:
    """The push, with event mode and without where there are both."""
    modes = [("push", "", REFERENCE[1])]
    if WITHOUT_EVENT_MODE in signals:
        modes = [
            ("push, event mode", "eventModeUsed is true", REFERENCE[1]),
            ("push, no event mode", "eventModeUsed is false", WITHOUT_EVENT_MODE),
        ]
    return template("tissue/fmu/build/experiments.xml.jinja").render(
        name=model.name,
        push=f"One push into the model, a step per sample: every importer should read this {model.output.quantity}",
        experiments=[(title, words, _source(output)) for title, words, output in modes],
        input=_source(REFERENCE[0]),
        stop=signals[REFERENCE[0]].splitlines()[-1].split(",")[0],
        step=float(model.sampling_time),
    )
