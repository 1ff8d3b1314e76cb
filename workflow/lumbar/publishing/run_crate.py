"""A run as a Workflow Run RO-Crate: one archive that holds and describes code, inputs, environment and outputs, to be cited.

After the profile Workflow Run Crate 0.5 of RO-Crate 1.1 (https://w3id.org/ro/wfrun/workflow/0.5). The metadata are written by
hand: they are a list of records, and the same run gives the same bytes.
"""

import base64
import hashlib
import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lumbar.base.files import replacing
from lumbar.base.yaml_file import shipped_yaml

METADATA = "ro-crate-metadata.json"
MAIN = "Snakefile"
_SAID = shipped_yaml(Path(__file__).with_suffix(".yaml"))
FORMATS: dict[str, str] = _SAID["formats"]
_OF_RUN = ("root", "workflow", "action")
OLDEST = (1980, 1, 1, 0, 0, 0)
"""Time of every member of the archive: the oldest that ZIP knows."""


@dataclass(frozen=True)
class Run:
    """What is told of a run beside its files."""

    study: str
    title: str
    data: str
    """`study`, `title`, `data`: name and title of the study; where its data come from."""
    ended: datetime
    outputs: dict[str, str]
    """What each output is, by its name in the archive."""
    configuration: str
    """Name in the archive of the merged configuration."""
    versions: dict[str, str | None]
    """By package; None where it is not installed."""
    environment: dict[str, str] = field(default_factory=dict)
    """Variables on which the bytes depend."""
    recordings: tuple[tuple[str, str], ...] = ()
    """SHA-256 and name of each recording that was given to the run."""
    source: dict[str, str] = field(default_factory=dict)
    """``name``, ``licence`` and ``obtain`` of the recordings; empty where the run made them."""


def end_of_run(results: Mapping[str, Path], epoch: str | None) -> datetime:
    """When the run ended: as declared in SOURCE_DATE_EPOCH, or when its last result was written."""
    seconds = int(epoch) if epoch else int(max(path.stat().st_mtime for path in results.values()))
    return datetime.fromtimestamp(seconds, UTC)


def write_crate(path: str | Path, run: Run, results: Mapping[str, Path], project: Mapping[str, Path]) -> None:
    """Write the archive, whole or not at all: outputs of the run and files of the project, by their names in it."""
    contents = {name: Path(file).read_bytes() for name, file in {**project, **results}.items()}
    contents |= dict.fromkeys(_folders(contents), b"")
    contents[METADATA] = (json.dumps(metadata(run, contents), indent=1, ensure_ascii=False) + "\n").encode()
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(contents.items()):
            archive.writestr(zipfile.ZipInfo(name, OLDEST), content, zipfile.ZIP_DEFLATED)


def metadata(run: Run, contents: Mapping[str, bytes]) -> dict:
    """Return ``ro-crate-metadata.json`` of an archive with these contents.

    Files of the project are records of their own where they are inputs or tell how to use the rest; the others belong
    to the record of their folder.
    """
    guides = ("README.md", "LICENSE", "CITATION.cff", "envs/lock.txt", "resources/README.md")
    told = [name for name in guides if name in contents]
    published = sorted(name for name in contents if name.startswith("resources/") and name not in told)
    folders = _folders(contents)
    files = [*told, run.configuration, *published, *sorted(run.outputs)]
    recordings = [_recording(name, digest, run.source) for digest, name in run.recordings]
    software = [_software(name, version) for name, version in sorted(run.versions.items()) if version]
    variables = [
        {"@id": f"#{name}", "@type": "PropertyValue", "name": name, "value": value}
        for name, value in sorted(run.environment.items())
    ]
    inputs = [run.configuration, *published, *(item["@id"] for item in recordings)]
    parts = [MAIN, *files, *folders, *(item["@id"] for item in recordings)]
    fixed = {name: _filled(_SAID[name], run=run, ended=run.ended.isoformat()) for name in _OF_RUN}
    root = fixed["root"] | {"name": run.title or run.study, "hasPart": _references(parts)}
    workflow = _file(MAIN, contents[MAIN], _SAID["about"]) | fixed["workflow"]
    workflow["softwareRequirements"] = _references(["envs/lock.txt", *(item["@id"] for item in software)])
    action = fixed["action"] | {
        "environment": _references(item["@id"] for item in variables),
        "object": _references(inputs),
        "result": _references(sorted(run.outputs)),
    }
    records = [
        _SAID["descriptor"],
        root,
        *_SAID["profiles"],
        workflow,
        *_SAID["named"],
        action,
        *(_file(name, contents[name], run.outputs.get(name, "")) for name in files),
        *({"@id": name, "@type": "Dataset", "name": f"{name} of the project"} for name in folders),
        *recordings,
        *software,
        *variables,
    ]
    return {"@context": _SAID["context"], "@graph": records}


def _folders(names: Iterable[str]) -> list[str]:
    """Return the folders of the project whose files are described together."""
    return sorted({f"{name.split('/')[0]}/" for name in names if "/" in name} - {"resources/", "results/"})


def _filled(said: Any, **words: Any) -> Any:
    """Return what is said of something with `words` for what stands in braces."""
    if isinstance(said, dict):
        return {key: _filled(item, **words) for key, item in said.items()}
    if isinstance(said, list):
        return [_filled(item, **words) for item in said]
    return said.format(**words)


def _references(names: Iterable[str]) -> list[dict]:
    return [{"@id": name} for name in names]


def _file(name: str, content: bytes, label: str) -> dict:
    record = {
        "@id": name,
        "@type": "File",
        "name": label or name,
        "contentSize": str(len(content)),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    if Path(name).suffix in FORMATS:
        record["encodingFormat"] = FORMATS[Path(name).suffix]
    if name == "README.md":
        record["about"] = {"@id": "./"}
    return record


def _recording(name: str, digest: str, source: Mapping[str, str]) -> dict:
    """Describe a recording that the archive does not hold; its content names it (RFC 6920)."""
    named = base64.urlsafe_b64encode(bytes.fromhex(digest)).rstrip(b"=").decode()
    return _filled(_SAID["recording"], name=name, named=named, digest=digest, source=source)


def _software(name: str, version: str) -> dict:
    """Describe a package; its name is a package URL (https://github.com/package-url/purl-spec)."""
    kind = "generic" if name in ("python", "lumbar") else "pypi"
    return _filled(_SAID["software"], kind=kind, name=name, version=version)
