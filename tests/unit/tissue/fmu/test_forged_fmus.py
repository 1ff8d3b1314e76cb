"""FMUs as a stranger might forge them: refused in words, within memory and time, nothing of another file shown or written."""

import os
import random
import sys
import zipfile
from pathlib import Path

import pytest

from lumbar.tissue.fmu.check.file_check import check_files
from running import python

XML = "modelDescription.xml"
MOST_MB, MOST_SECONDS = 500, 20
MEASURED = (
    "import resource, subprocess, sys; told = subprocess.run(sys.argv[1:], capture_output=True, text=True, errors='replace', "
    "stdin=subprocess.DEVNULL); used = resource.getrusage(resource.RUSAGE_CHILDREN); "
    "print(told.returncode, used.ru_maxrss // 1024, used.ru_utime + used.ru_stime); print(told.stdout + told.stderr)"
)


def described(change) -> dict:
    return {"change": lambda files: files.__setitem__(XML, change(files[XML].decode()).encode())}


def named(identifier: str) -> dict:
    return described(lambda text: text.replace('modelIdentifier="', f'modelIdentifier="{identifier}" was="'))


def entity(value: str) -> dict:
    return described(
        lambda text: (
            f'<?xml version="1.0"?><!DOCTYPE a [{value}]>'
            + text.split("?>", 1)[1].replace("lumbar", "&a;", 1)
        )
    )


def link(path: str) -> tuple[zipfile.ZipInfo, bytes]:
    info = zipfile.ZipInfo(path)
    info.external_attr = 0o120777 << 16
    return info, b"/etc/passwd"


BILLION = '<!ENTITY z "zzzzzzzzzz">' + "".join(
    f'<!ENTITY {name} "{f"&{below};" * 10}">' for below, name in zip("zhgfedcb", "hgfedcba", strict=True)
)
FORGED = {
    "no description": {"drop": XML},
    "half a description": described(lambda text: text[: len(text) // 2]),
    "a billion entities": entity(BILLION),
    "an entity of a local file": entity('<!ENTITY a SYSTEM "file:///etc/passwd">'),
    **{
        f"the encoding {name}": described(lambda text, name=name: text.replace("UTF-8", name, 1))
        for name in ("big5", "nobody's", "rot13")
    },
    "170,000 attributes": described(
        lambda text: text.replace(" fmiVersion", "".join(f' a{k}=""' for k in range(170_000)) + " fmiVersion")
    ),
    "nested elements": described(lambda text: "<a>" * 200_000 + "</a>" * 200_000),
    "300,000 variables": described(
        lambda text: text.replace(
            "</ModelVariables>",
            "".join(f'<Float64 name="v{k}" valueReference="{k}"/>' for k in range(10_000, 310_000))
            + "</ModelVariables>",
        )
    ),
    **{
        f"identifier {name[:12]!r}": named(name)
        for name in ("../../../../ev", "/etc/passwd", "con", "", "x" * 5000)
    },
    "150 MB of zeros": {"more": [("resources/zeros", b"\0" * 150_000_000)]},
    "500 MB of zeros": {"more": [(f"resources/{k}", b"\0" * 100_000_000) for k in range(5)]},
    "400 MB that are said to be ten bytes": {
        "more": [("resources/zeros", b"\0" * 400_000_000)],
        "central": lambda entry: entry[:24] + (10).to_bytes(4, "little") + entry[28:],
    },
    "a file under a password": {
        "more": [("resources/x", b"x")],
        "central": lambda entry: entry[:8] + b"\1" + entry[9:],
    },
    "a packing that nobody knows": {
        "more": [("resources/x", b"x")],
        "central": lambda entry: entry[:10] + b"\x63" + entry[11:],
    },
    "70,000 files": {"more": [(f"documentation/{k}", b"") for k in range(70_000)]},
    "a way out": {"more": [("../../evil.txt", b"x"), ("/evil.txt", b"x"), ("..\\evil.txt", b"x")]},
    "a link": {"more": [link("resources/link")]},
    "a link for a library": {"more": [link("binaries/x86_64-linux/KB.so")]},
    "nested lists": {"change": lambda files: files.__setitem__("resources/model.json", b"[" * 200_000)},
    "a number of 5000 digits": {
        "change": lambda files: files.__setitem__("resources/model.json", b"9" * 5000)
    },
    "40 MB of numbers": {
        "change": lambda files: files.__setitem__("resources/model.json", b"[" + b"1," * 20_000_000 + b"1]")
    },
}


def forge(sound: Path, path: Path, change=None, drop: str = "", more=(), central=None) -> Path:
    with zipfile.ZipFile(sound) as archive:
        files = {name: archive.read(name) for name in archive.namelist() if name != drop}
    if change is not None:
        change(files)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry in (*files.items(), *more):
            archive.writestr(*entry)
    if central is not None:  # what the list at the end says of the last file
        data = path.read_bytes()
        place = data.rindex(b"PK\1\2")
        path.write_bytes(data[:place] + central(data[place:]))
    return path


def flipped(sound: Path, path: Path, seed: int) -> Path:
    """A few bytes changed, or the end lost."""
    drawn, data = random.Random(seed), bytearray(sound.read_bytes())
    for _ in range(20):
        data[drawn.randrange(len(data))] = drawn.randrange(256)
    path.write_bytes(data[: drawn.randrange(len(data))] if seed % 3 == 0 else data)
    return path


def refused(path: Path) -> None:
    command = [str(Path(sys.executable).with_name("lumbar")), "check", str(path)]
    head, _, words = python("-c", MEASURED, *command).partition("\n")
    status, megabytes, seconds = map(float, head.split())
    assert status == 1 and words.strip(), (path.name, words)
    assert "Traceback" not in words and "root:" not in words, (path.name, words)
    assert len(words) < 20_000, path.name
    assert megabytes < MOST_MB and seconds < MOST_SECONDS, (path.name, megabytes, seconds)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", FORGED)
def test_a_forged_fmu_is_refused(kind, fmu_folder, tmp_path):
    refused(
        forge(next(iter(sorted(fmu_folder.glob("KB*_fmi3.fmu")))), tmp_path / "forged.fmu", **FORGED[kind])
    )
    assert [path.name for path in tmp_path.rglob("*")] == ["forged.fmu"] and not Path("/evil.txt").exists()


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_fmu_is_refused(seed, fmu_folder, tmp_path):
    refused(flipped(next(iter(sorted(fmu_folder.glob("KB*_fmi3.fmu")))), tmp_path / "damaged.fmu", seed))


def test_sources_that_nothing_was_compared_with_are_not_compiled(fmu_folder, zig_cache, tmp_path):
    """They would read this machine's files, and the compiler knows no limits; another release wrote other ones."""

    def change(files):
        for name, content in files.items():
            files[name] = content.replace(b"lumbar 0.1.0", b"lumbar 0.0.9").replace(
                b'version="0.1.0', b'version="0.0.9'
            )
        files["sources/fmi3.c"] += b'\n#include "/etc/passwd"\n'

    forged = forge(fmu_folder / "KB_fmi3.fmu", tmp_path / "forged.fmu", change)
    [check] = check_files([forged], zig_cache)
    assert check.problems == ()
    assert "its sources were not compiled; what it says was not compared: lumbar 0.0.9" in str(check)


@pytest.mark.parametrize(
    "made", [os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")], ids=["pipe", "folder", "device"]
)
def test_what_is_no_file_is_not_read(made, tmp_path):
    made(tmp_path / "forged.fmu")
    refused(tmp_path / "forged.fmu")
