"""Detached signatures of FMUs in OpenSSH's format: ``KB_fmi3.fmu.sig`` beside ``KB_fmi3.fmu``.

``ssh-keygen`` signs and verifies: it has the keys that people have already, in files, agents and on hardware, and whoever is
given a file can verify it without this program.
"""

import os
import re
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path
from shutil import which

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import replacing

NAMESPACE = "file"
"""What OpenSSH calls signatures of files; one that was given for mail or a commit is none."""
_PUBLIC_KEY = re.compile(r"(sk-)?(ssh|ecdsa)-[\w@.-]+ [A-Za-z0-9+/]+=*( .*)?")
_KEY = re.compile(r" with (\S+ key \S+)")


def signature_of(path: Path) -> Path:
    """Path of the signature that belongs to a file."""
    return path.with_name(f"{path.name}.sig")


def sign_new_files(paths: Iterable[Path], key: Path) -> list[Path]:
    """Sign files that were just written and return the paths of their signatures; where one fails, none is left.

    Parameters
    ----------
    key : Path
        Private key of OpenSSH, or the public one whose other half an agent holds. A passphrase is asked for on the terminal.

    Raises
    ------
    InputError
        There is no ``ssh-keygen``, it refuses the key, or a signature cannot be written.
    """
    paths = list(paths)
    try:
        return [_signed(path, key) for path in paths]
    except InputError:
        for path in paths:
            path.unlink()
            signature_of(path).unlink(missing_ok=True)
        raise


def _signed(path: Path, key: Path) -> Path:
    done = _ssh_keygen("sign", "-f", str(key.absolute()), data=path)
    if done.returncode:
        needed = "a key as ssh-keygen -t ed25519 makes it is needed, and its passphrase where it has one"
        raise InputError(f"{key}: {path.name} cannot be signed with it ({_said(done)}); {needed}")
    try:
        with replacing(signature_of(path)) as temporary:
            temporary.write_bytes(done.stdout)
    except OSError as error:
        raise InputError(f"{signature_of(path)}: cannot be written ({error.strerror})") from error
    return signature_of(path)


def verify(paths: Iterable[Path], keys: Path) -> list[str]:
    """Verify that each file is what the owner of one of the keys signed, and return the key that it was, in words.

    Parameters
    ----------
    keys : Path
        Public keys of OpenSSH, a line each: a file ``.pub``, or several of them in one.

    Raises
    ------
    InputError
        There is no ``ssh-keygen``, the file holds no keys, or files are not signed by them: all problems at once.
    """
    paths = list(paths)
    problems = Problems("signatures")
    found = []
    with tempfile.TemporaryDirectory(prefix="lumbar-keys-") as folder:
        signers = Path(folder) / "allowed_signers"
        signers.write_text("".join(f"* {line}\n" for line in _public_keys(keys)), encoding="utf-8")
        for path in paths:
            signature = signature_of(path)
            if not signature.is_file():
                problems.add(
                    path.name,
                    f"there is no {signature.name}",
                    "a file that lumbar export --sign made has one beside it",
                )
                continue
            given = ("-s", str(signature.absolute()))
            done = _ssh_keygen("verify", "-f", str(signers), "-I", "signer", *given, data=path)
            if done.returncode:
                problems.add(path.name, _refused(_ssh_keygen("check-novalidate", *given, data=path), keys))
            found.append(_signer(done))
    problems.raise_if_any()
    return found


def _public_keys(path: Path) -> list[str]:
    """Lines of a file of public keys."""
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no file of public keys ({error})") from error
    keys = [line for line in lines if line and not line.startswith("#")]
    for line in keys:
        if not _PUBLIC_KEY.fullmatch(line):
            allowed = "lines as in id_ed25519.pub are needed: ssh-ed25519 AAAA… name"
            raise InputError(f"{path}: {line[:40]!r} is no public key; {allowed}")
    if not keys:
        raise InputError(f"{path}: holds no public key")
    return keys


def _refused(unasked: subprocess.CompletedProcess, keys: Path) -> str:
    """Why a signature does not hold, from what it is whoever gave it."""
    if unasked.returncode == 0:
        return f"signed with {_signer(unasked)}, which {keys.name} does not hold"
    return f"the file is not what was signed, or the signature is damaged ({_said(unasked)})"


def _signer(done: subprocess.CompletedProcess) -> str:
    key = _KEY.search(done.stdout.decode("utf-8", errors="replace"))
    return key[1] if key else ""


def _said(done: subprocess.CompletedProcess) -> str:
    return (
        "; ".join(done.stderr.decode("utf-8", errors="replace").split("\n")).strip("; ") or "it said nothing"
    )


def _ssh_keygen(what: str, *arguments: str, data: Path) -> subprocess.CompletedProcess:
    """Let ssh-keygen sign or verify what stands in a file."""
    program = which("ssh-keygen")
    if program is None:
        raise InputError("no ssh-keygen, which signs and verifies: install OpenSSH 8.2 or newer")
    command = [program, "-Y", what, "-n", NAMESPACE, *arguments]
    try:
        with data.open("rb") as file:
            return subprocess.run(
                command, stdin=file, capture_output=True, check=False, env={**os.environ, "LC_ALL": "C"}
            )
    except OSError as error:
        raise InputError(f"{data}: cannot be read ({error.strerror})") from error
