"""How readers take broken files: 20,000 of them, or as many as are asked for.

    python benchmarks/fuzzing.py [COUNT [SEED]]

Prints how many were read and refused by kind, and the longest time; files that ended in another error than a refusal are kept and
named.
"""

from __future__ import annotations

import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(PROJECT / "tests" / "unit"), str(PROJECT / "workflow")]

if __name__ == "__main__":
    from forged_files import drawn, read_forged

    warnings.simplefilter("ignore")
    count, seed = (*map(int, sys.argv[1:3]), *(20_000, 1)[len(sys.argv) - 1 :])
    read, refused, failures, longest = Counter(), Counter(), {}, 0.0
    folder = Path(tempfile.mkdtemp(prefix="fuzzed_"))
    for name, content in drawn(count, seed):
        path = folder / name
        path.write_bytes(content)
        began = time.monotonic()
        try:
            (refused if read_forged(path) else read)[path.suffix] += 1
        except Exception as error:  # everything that is no refusal is a finding
            failures[path] = f"{type(error).__name__}: {str(error)[:200]}"
        else:
            path.unlink()
        longest = max(longest, time.monotonic() - began)
    for ending in sorted(read | refused):
        print(f"{ending}: {read[ending]} read, {refused[ending]} refused")
    print(f"longest {longest:.2f} s")
    print(f"{len(failures)} failures")
    for path, words in failures.items():
        print(f"{path}: {words}")
    sys.exit(bool(failures))
