"""What an FMU tells in several places is held together: whatever is altered in one of them is named with that place."""

import hashlib
import json
from functools import cache

import pytest
from c_programs import ON_LINUX
from test_runtime_defects import DESCRIPTION, contents

from case_tables import cases
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.fmu.check import agreement
from lumbar.tissue.fmu.check.agreement import PAGE, hold_together
from lumbar.tissue.fmu.conventions import MANIFEST, RECORD, REFERENCE, WITHOUT_EVENT_MODE

pytestmark = ON_LINUX
NUMBERS = "sources/model_data.h"
ALTERED = {
    **cases(__file__, "altered"),
    REFERENCE[0]: [
        ("time,position", "time,position_mm"),
        ("\n0.05,", "\n0.051,"),
        ("\n1.3,0.0", "\n1.3,0.1"),
        ("\n0.01,0.0", "\n0.01,nan"),
    ],
    REFERENCE[1]: [("\n0.01,", "\n"), ("\n", ",0\n")],
}
"""By file: what stands there, and what it is altered to; all of one kind of file is compared alike."""
FMI3 = cases(__file__, "altered_fmi3")
FMI2 = cases(__file__, "altered_fmi2")
CASES = [
    (version, path, *change)
    for version, tables in ((3, (ALTERED, FMI3)), (2, (ALTERED, FMI2)))
    for table in tables
    for path, changes in table.items()
    for change in changes
]


@pytest.fixture(scope="module", autouse=True)
def written_once():
    """Write each model anew once for all tests: it takes longer than all that is tested."""
    written = agreement.written_files

    @cache
    def once(*given, signals=()):
        return written(*given, dict(signals))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            agreement,
            "written_files",
            lambda model, version, data, drawn, signals=None: once(
                model, version, data, drawn, signals=tuple((signals or {}).items())
            ),
        )
        yield


@pytest.fixture(scope="module")
def sound(fmu_folder):
    """Files of an FMU by version."""
    return {version: contents(fmu_folder / f"KB_fmi{version}.fmu") for version in (2, 3)}


def told(files: dict[str, bytes]) -> tuple[str, ...]:
    return hold_together(files, CATALOGUES).problems


@pytest.mark.parametrize(
    ("version", "path", "before", "after"),
    CASES,
    ids=[f"{path}-{after}-fmi{v}" for v, path, _, after in CASES],
)
def test_what_is_altered_in_one_place_is_named_with_that_place(version, path, before, after, sound):
    files = dict(sound[version])
    files[path] = files[path].replace(before.encode(), after.encode())
    assert files[path] != sound[version][path], f"{before} is not in {path}"
    found = told(files)
    assert any(path in sentence for sentence in found), found


@pytest.mark.parametrize("version", [2, 3])
def test_files_that_are_missing_or_too_many_are_named(version, sound):
    for path in (
        set(sound[version])
        - {DESCRIPTION}
        - {name for name in sound[version] if name.startswith("binaries/")}
    ):
        found = told({name: content for name, content in sound[version].items() if name != path})
        assert any(f"there is no {path}" in sentence for sentence in found), found
    for path in ("README.txt", "documentation/manual.pdf", "resources/notes.txt", "sources/spare.c"):
        assert told({**sound[version], path: b"x"}) == (f"{path} is no part of this FMU",)
    icon = "model.png" if version == 2 else "terminalsAndIcons/icon.png"
    assert told({**sound[version], icon: b"x"}) == (
        f"{icon} is another picture (1 bytes); by {RECORD} it is one of 2357 bytes",
    )
    for broken in (b"{}", b"[]", b"null", b"\xff", b'{"written_by": "lumbar 0.1.0"}'):
        assert len(told({**sound[version], RECORD: broken})) == 1


def test_sentences_say_what_stands_there_and_what_should(sound):
    files, record = sound[3], f"by {RECORD}"
    for path, before, after, sentence in (
        (
            DESCRIPTION,
            'start="1.0"',
            'start="2.0"',
            f"{DESCRIPTION}, ModelVariables, Float64 gain: start is '2.0'; {record} it is '1.0'",
        ),
        (
            PAGE,
            "(30 ms)",
            "(3 ms)",
            f"{PAGE}, line 15 is '…last 3 samples (3 ms) of position − p…'; {record} it is "
            "'…last 3 samples (30 ms) of position − p…'",
        ),
        (
            REFERENCE[0],
            "\n1.3,0.0",
            "\n1.3,0.1",
            f"{REFERENCE[0]}, line 132: position is 0.1; {record} it is 0.0",
        ),
    ):
        assert told({**files, path: files[path].replace(before.encode(), after.encode())}) == (sentence,)
    record = json.loads(files[RECORD])
    record["runtime"]["output_limit"] = 7.0
    many = told({**files, RECORD: json.dumps(record).encode()})
    assert many[-1].endswith(f"more differences from {RECORD}")


def test_order_and_what_stands_twice_matter(sound):
    lines = sound[3][DESCRIPTION].decode().splitlines(keepends=True)
    offset, limit = (
        next(k for k, line in enumerate(lines) if f'name="force_{name}"' in line)
        for name in ("offset", "limit")
    )
    lines[offset], lines[limit] = lines[limit], lines[offset]
    found = told({**sound[3], DESCRIPTION: "".join(lines).encode()})
    assert found == (
        f"{DESCRIPTION}, ModelVariables, Float64 force_limit is out of its order; by {RECORD} it is in the "
        "order of the variables",
    )
    swapped = {REFERENCE[1]: sound[3][WITHOUT_EVENT_MODE], WITHOUT_EVENT_MODE: sound[3][REFERENCE[1]]}
    assert {sentence.split(",")[0] for sentence in told({**sound[3], **swapped})} == set(swapped)


@pytest.mark.parametrize("version", [2, 3])
def test_digits_that_another_machine_rounds_otherwise_are_no_difference(version, sound):
    """The last bits of numbers, the token that follows from them and the manifest's checksums."""
    files = dict(sound[version])
    files[NUMBERS] = files[NUMBERS].replace((1.9).hex().encode(), (1.9 + 4e-16).hex().encode())
    files[REFERENCE[1]] = b"".join(
        line.replace(b"5,", b"5000000000000001,") if line.startswith(b"0.0") else line
        for line in files[REFERENCE[1]].splitlines(keepends=True)
    )
    old, new = (hashlib.sha3_256(content[REFERENCE[1]]).hexdigest() for content in (sound[version], files))
    files[MANIFEST] = files[MANIFEST].replace(old.encode(), new.encode())
    (problem,) = told(files)
    token, own = problem.split("the token is ")[1].split("; that of the model and these sources is ")
    files = {
        name: text.replace(token.encode(), own.encode()).replace(
            b"+" + token[:8].encode(), b"+" + own[:8].encode()
        )
        for name, text in files.items()
    }
    assert told(files) == ()


def test_what_another_release_wrote_is_left_to_it(sound):
    files = dict(sound[3])
    release = b"0.0.9"
    files[DESCRIPTION] = (
        files[DESCRIPTION]
        .replace(b"lumbar 0.1.0", b"lumbar " + release)
        .replace(b'version="0.1.0+', b'version="' + release + b"+")
    )
    files[RECORD] = files[RECORD].replace(b"lumbar 0.1.0", b"lumbar " + release)
    found = hold_together(files, CATALOGUES)
    assert (found.problems, found.left_out) == (
        (),
        "what it says was not compared: lumbar 0.0.9 wrote it, this is lumbar 0.1.0",
    )
    del files[RECORD]
    assert hold_together(files, CATALOGUES).left_out
