"""Signatures of FMUs: given, verified, by others' ``ssh-keygen`` too, and refused where file, key or signature is another."""

import shutil
import subprocess
from pathlib import Path

import pytest

from lumbar.base.errors import InputError
from lumbar.tissue.fmu.signature import sign_new_files, signature_of, verify

pytestmark = pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="no ssh-keygen: install OpenSSH")


def made(folder: Path, name: str) -> Path:
    """Private key in a new file."""
    subprocess.run(
        ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", name], cwd=folder, check=True
    )
    return folder / name


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Private keys by owner; the public ones lie beside them."""
    folder = tmp_path_factory.mktemp("keys")
    return {name: made(folder, name) for name in ("lab", "other")}


@pytest.fixture
def signed(keys, tmp_path):
    """A file signed by the lab."""
    path = tmp_path / "KB_fmi3.fmu"
    path.write_bytes(bytes(range(256)) * 100)
    sign_new_files([path], keys["lab"])
    return path


def public(key: Path) -> Path:
    return key.with_name(f"{key.name}.pub")


def test_a_signature_holds_for_its_key_alone(signed, keys, tmp_path):
    (found,) = verify([signed], public(keys["lab"]))
    assert found.startswith("ED25519 key SHA256:")
    both = tmp_path / "both.pub"
    both.write_text("# of us\n" + public(keys["other"]).read_text() + public(keys["lab"]).read_text())
    assert verify([signed], both) == [found]
    with pytest.raises(
        InputError, match=r"KB_fmi3\.fmu: signed with ED25519 key SHA256:.*, which other\.pub does not hold"
    ):
        verify([signed], public(keys["other"]))


def test_ssh_keygen_verifies_it_too(signed, keys):
    """As whoever is given the file may, with a list of signers of their own."""
    signers = signed.with_name("allowed_signers")
    signers.write_text(f"lab@example.org {public(keys['lab']).read_text()}")
    command = ["ssh-keygen", "-Y", "verify", "-f", signers, "-I", "lab@example.org", "-n", "file"]
    command += ["-s", signature_of(signed)]
    assert (
        subprocess.run(command, input=signed.read_bytes(), check=False, capture_output=True).returncode == 0
    )
    assert subprocess.run(command, input=b"another", check=False, capture_output=True).returncode != 0


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda path, keys: flipped(path), "KB_fmi3.fmu: the file is not what was signed, or the signature is damaged"),
        (lambda path, keys: flipped(signature_of(path)), "the file is not what was signed, or the signature is damaged"),
        (lambda path, keys: signature_of(path).unlink(), "there is no KB_fmi3.fmu.sig; a file that lumbar export --sign"),
        (lambda path, keys: signature_of(path).write_text("-"), "the signature is damaged"),
        (lambda path, keys: path.unlink(), "KB_fmi3.fmu: cannot be read"),
    ],
)  # fmt: skip
def test_what_does_not_hold_is_told(change, words, signed, keys):
    change(signed, keys)
    with pytest.raises(InputError) as caught:
        verify([signed], public(keys["lab"]))
    assert words in str(caught.value)


def test_a_signature_of_something_else_than_a_file_is_none(signed, keys):
    """One key signs mail and commits too: what it was given for counts."""
    command = ["ssh-keygen", "-q", "-Y", "sign", "-f", keys["lab"], "-n", "git"]
    done = subprocess.run(command, input=signed.read_bytes(), check=True, capture_output=True)
    signature_of(signed).write_bytes(done.stdout)
    with pytest.raises(InputError, match="namespace does not match"):
        verify([signed], public(keys["lab"]))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no file of public keys"),
        ("", "holds no public key"),
        ("* ssh-ed25519 AAAA", "is no public key; lines as in id_ed25519.pub are needed"),
        ("-----BEGIN OPENSSH PRIVATE KEY-----", "is no public key"),
    ],
)
def test_a_file_that_holds_no_public_keys_is_refused(content, words, signed, tmp_path):
    path = tmp_path / "keys.pub"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=words):
        verify([signed], path)


def test_files_that_cannot_be_signed_are_not_left(keys, tmp_path):
    paths = [tmp_path / "a.fmu", tmp_path / "b.fmu"]
    for path in paths:
        path.write_bytes(b"x")
    with pytest.raises(InputError, match=r"absent: a\.fmu cannot be signed with it"):
        sign_new_files(paths, tmp_path / "absent")
    assert not list(tmp_path.iterdir())


def test_without_openssh_that_is_said(signed, keys, monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="install OpenSSH"):
        verify([signed], public(keys["lab"]))


def test_the_commands_sign_and_verify(run, keys, tmp_path):
    """Nothing of a file that another has signed is run: its library is not looked at."""
    from runtime_models import models_json

    from lumbar.base.files import write_json

    write_json(tmp_path / "models.json", models_json())
    out = tmp_path / "fmu"
    status, printed, told = run(
        "export", tmp_path / "models.json", "--model", "KB", "--sign", keys["lab"], "--output", out
    )
    assert (status, len(printed.splitlines())) == (0, 2), told
    assert {path.name for path in out.iterdir()} == {
        f"KB_fmi{version}.fmu{ending}" for version in (2, 3) for ending in ("", ".sig")
    }
    printed = run.done("check", out, "--key", public(keys["lab"]))
    assert printed.count("the same library; signed with ED25519 key SHA256:") == 2
    flipped(out / "KB_fmi3.fmu")
    status, printed, told = run("check", out, "--key", public(keys["lab"]))
    assert (status, printed) == (1, "")
    assert "KB_fmi3.fmu: the file is not what was signed" in told
    run.refused("check", tmp_path / "models.json", "--key", public(keys["lab"]))
