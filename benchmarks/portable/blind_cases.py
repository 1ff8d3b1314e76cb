"""Diagnoses every blind case of a folder: ``python blind_cases.py CASES OUTPUT``.

Calls the command ``lumbar diagnose`` in this process, but leaves the number of threads to the environment.
"""

import sys
from pathlib import Path

from lumbar.cli import command

command.use_one_thread = lambda: None
cases, output = map(Path, sys.argv[1:])
folders = sorted(path for path in cases.iterdir() if path.is_dir())
failed = [
    folder.name
    for folder in folders
    if command.main(["diagnose", str(folder), "--output", str(output / folder.name)])
]
print(f"{len(folders)} cases, {len(failed)} failed: {' '.join(failed) or 'none'}")
sys.exit(bool(failed or not folders))
