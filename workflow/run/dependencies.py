"""Source files of the library that a script uses, from its import statements, and the versions of packages.

Snakemake re-runs a rule when one of its parameters changes, but it does not see imports. So every rule has
`library_code` of its script as a parameter. A hundred input files per job would dominate the plan of a large study.
"""

import ast
import hashlib
import platform
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

WORKFLOW = Path(__file__).resolve().parents[1]
PACKAGE = "lumbar"
_IMPORT = re.compile(r"^[ \t]*(?:import|from)[ \t][^(#\n]*(?:\([^)]*\))?", flags=re.M)
_CODE_ENDINGS = {".py", ".pyc", ".pyi", ".typed"}


@cache
def _module_file(name: str) -> Path | None:
    path = WORKFLOW.joinpath(*name.split("."))
    if (path / "__init__.py").is_file():
        return path / "__init__.py"
    return path.with_suffix(".py") if path.with_suffix(".py").is_file() else None


def _import_statements(source: str) -> Iterator[ast.Import | ast.ImportFrom]:
    """Return the import statements of a source at any depth. Parsing only these statements saves a second."""
    for statement in _IMPORT.finditer(source):
        try:
            yield from ast.parse(statement[0].strip()).body
        except SyntaxError:
            continue  # a line of prose


@cache
def _modules_of_functions() -> dict[str, str]:
    """Return the module of each function of ``import lumbar``, which imports it when it is first used."""
    stub = (WORKFLOW / PACKAGE / "__init__.pyi").read_text(encoding="utf-8")
    statements = (node for node in _import_statements(stub) if isinstance(node, ast.ImportFrom))
    return {alias.name: str(node.module) for node in statements for alias in node.names}


@cache
def _imported(path: Path) -> frozenset[Path]:
    """Return the library files that one source file imports, at any depth of its functions, with their packages."""
    names, source = set(), path.read_text(encoding="utf-8")
    for node in _import_statements(source):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    if PACKAGE in names and path.parent.name != PACKAGE:
        used = set(re.findall(rf"\b{PACKAGE}\.(\w+)", source))
        names.update(module for name, module in _modules_of_functions().items() if name in used)
    files = set()
    for name in names:
        parts = name.split(".")
        if parts[0] == PACKAGE:
            files.update(_module_file(".".join(parts[:count])) for count in range(1, len(parts) + 1))
        elif len(parts) == 1 and (WORKFLOW / "scripts" / f"{name}.py").is_file():
            files.add(WORKFLOW / "scripts" / f"{name}.py")
    return frozenset(file for file in files if file is not None)


@cache
def _data_files(folder: Path) -> frozenset[Path]:
    """Return the data files in a folder of modules, and in folders below it without modules."""
    files: set[Path] = set()
    for path in folder.iterdir():
        if path.is_dir():
            files |= set() if (path / "__init__.py").is_file() else _data_files(path)
        elif path.suffix not in _CODE_ENDINGS and not path.name.startswith("."):
            files.add(path)
    return frozenset(files)


def library_sources(script: str) -> list[str]:
    """Return the sorted paths of all library files that a script of ``workflow/scripts`` imports, directly or through others.

    Data files (C sources, tables, fonts) in the package of an imported module, or in a folder below it, count too.
    """
    pending = [WORKFLOW / "scripts" / script]
    seen: set[Path] = set()
    while pending:
        for file in _imported(pending.pop()):
            if file not in seen:
                seen.add(file)
                pending.append(file)
    for folder in {file.parent for file in seen if file.is_relative_to(WORKFLOW / PACKAGE)}:
        seen |= _data_files(folder)
    return sorted(str(file) for file in seen)


def _normal_name(package: str) -> str:
    return re.sub(r"[-_.]+", "-", package).lower()


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that jobs need, by their names.

    Snakemake and its plugins are left out: no result depends on them.
    """
    lock = (WORKFLOW.parent / "envs" / "runtime-lock.txt").read_text(encoding="utf-8")
    needed = {_normal_name(name) for name in re.findall(r"^([\w.-]+)==", lock, flags=re.M)}
    versions = {"python": platform.python_version()}
    for folder in reversed(sys.path):  # the first folder precedes the others
        for path in Path(folder).glob("*-*.dist-info"):  # the contents are slow to read
            name, version = path.stem.rsplit("-", 1)
            if _normal_name(name) in needed:
                versions[_normal_name(name)] = version
    return {name: versions[name] for name in sorted(versions) if not name.startswith("snakemake")}


@cache
def library_code(script: str) -> str:
    """Return a digest of the files in `library_sources` and of `package_versions`.

    It does not depend on the place of the project.
    """
    digest = hashlib.sha256(repr(package_versions()).encode())
    for path in map(Path, library_sources(script)):
        for part in (path.relative_to(WORKFLOW).as_posix().encode(), path.read_bytes()):
            digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()[:16]
