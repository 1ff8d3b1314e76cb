"""Run the steps of envs/Dockerfile in a clean root, where nothing builds images: Debian's minimal system from debootstrap.

``python3 benchmarks/container/run_dockerfile.py FOLDER [COMMAND...]`` (as root, with debootstrap) makes the root in FOLDER and
ends with COMMAND in it, or with the file's CMD. Only what the file uses is known: FROM debian, RUN, WORKDIR, COPY . ., ENV and
CMD; anything else is refused. The root is not an image: it has no layers, and the kernel, the network, the certificates and
pip's settings (PIP_*) are the machine's.
"""

from __future__ import annotations

import fnmatch
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
DOCKERFILE = PROJECT / "envs" / "Dockerfile"
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")


def steps(text: str) -> list[tuple[str, str]]:
    """Instructions of a Dockerfile with their arguments, lines that go on joined."""
    joined = re.sub(r"\\\n", " ", text)
    lines = [line for line in joined.splitlines() if line.strip() and not line.startswith("#")]
    return [tuple(line.split(maxsplit=1)) for line in lines]


def mirror() -> list[str]:
    """Address of this machine's Debian packages, where apt knows one other than debootstrap's own."""
    command = ["apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages"]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return [address for address in found if "security" not in address][:1]


class Root:
    """The clean root and what the steps so far have set."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.workdir = "/"
        self.environment = {
            "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": "/root",
        }

    def from_(self, image: str) -> None:
        """Install the base system; a folder that has one is taken as it is."""
        suite = re.fullmatch(r"debian:(\w+)-slim@sha256:[0-9a-f]{64}", image)
        if suite is None:
            raise SystemExit(f"FROM {image}: only debian:SUITE-slim@sha256:DIGEST can be made here")
        if not (self.folder / "usr" / "bin" / "apt-get").exists():
            subprocess.run(["debootstrap", "--variant=minbase", suite[1], self.folder, *mirror()], check=True)
        shutil.copy("/etc/resolv.conf", self.folder / "etc" / "resolv.conf")

    def run(self, command: str | list[str]) -> None:
        """Run in the root: its own processes and mounts, gone with the command."""
        words = ["/bin/sh", "-c", command] if isinstance(command, str) else command
        own = {key: value for key, value in os.environ.items() if key.startswith("PIP_")}
        if CERTIFICATES.is_file():  # apt-get install ca-certificates has written the distribution's
            copy = self.folder / CERTIFICATES.relative_to("/")
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(CERTIFICATES, copy)
        inside = 'cd "$0" && exec "$@"'
        mounts = 'mount -t proc proc "$0/proc" && mount --rbind /dev "$0/dev"'
        enter = f"""{mounts} && exec chroot "$0" sh -c '{inside}' "$@\""""
        isolated = ["unshare", "--mount", "--pid", "--fork", "sh", "-c", enter]
        subprocess.run(
            [*isolated, str(self.folder), self.workdir, *words], env={**own, **self.environment}, check=True
        )

    def copy(self, arguments: str) -> None:
        """Copy the project without what Dockerfile.dockerignore names."""
        if arguments != ". .":
            raise SystemExit(f"COPY {arguments}: only COPY . . is known here")
        ignored = DOCKERFILE.with_name("Dockerfile.dockerignore").read_text(encoding="utf-8").split()

        def left_out(folder, names):
            paths = {name: (Path(folder) / name).relative_to(PROJECT).as_posix() for name in names}
            return [
                name
                for name, path in paths.items()
                if any(fnmatch.fnmatch(path, item) or fnmatch.fnmatch(f"./{path}", item) for item in ignored)
            ]

        shutil.copytree(PROJECT, self.folder / self.workdir.strip("/"), ignore=left_out, dirs_exist_ok=True)

    def set(self, arguments: str) -> None:
        """Set a variable, whose value may name others."""
        name, _, value = arguments.partition("=")
        self.environment[name] = re.sub(r"\$(\w+)", lambda found: self.environment[found[1]], value)


def main(folder: Path, command: list[str]) -> None:
    """Run all steps, then the command."""
    root = Root(folder.resolve())
    for instruction, arguments in steps(DOCKERFILE.read_text(encoding="utf-8")):
        print(f"{instruction} {arguments}", flush=True)
        if instruction == "FROM":
            root.from_(arguments)
        elif instruction == "RUN":
            root.run(arguments)
        elif instruction == "WORKDIR":
            root.workdir = arguments
            (root.folder / arguments.strip("/")).mkdir(parents=True, exist_ok=True)
        elif instruction == "COPY":
            root.copy(arguments)
        elif instruction == "ENV":
            root.set(arguments)
        elif instruction == "CMD":
            root.run(command or json.loads(arguments))
        else:
            raise SystemExit(f"{instruction}: not known here")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
