"""How readers take broken files: 20,000 of them, or as many as are asked for.

    python benchmarks/fuzzing.py [COUNT [SEED]]

Prints how many were read and refused by kind, the longest time and the largest memory; files that ended in another error
than a refusal are kept and named.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections import Counter
from itertools import islice
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(PROJECT / "tests" / "unit"), str(PROJECT / "workflow")]
AT_ONCE = 500

if __name__ == "__main__":
    from forged_files import drawn, read_forged

    warnings.simplefilter("ignore")
    count, seed = (*map(int, sys.argv[1:3]), *(20_000, 1)[len(sys.argv) - 1 :])
    files, read, refused, failures, longest, largest = drawn(count, seed), Counter(), Counter(), {}, 0.0, 0.0
    while batch := list(islice(files, AT_ONCE)):
        folder = Path(tempfile.mkdtemp(prefix="fuzzed_"))
        for name, content in batch:
            (folder / name).write_bytes(content)
        outcome = read_forged(folder)
        read += Counter(Path(name).suffix for name in outcome["read"])
        refused += Counter(Path(name).suffix for name in outcome["refused"])
        failures |= {folder / name: words for name, words in outcome["failures"].items()}
        longest, largest = max(longest, *outcome["seconds"].values()), max(largest, outcome["largest_MB"])
        for name, _ in batch:
            if name not in outcome["failures"]:
                (folder / name).unlink()
        if not outcome["failures"]:
            folder.rmdir()
    for ending in sorted(read | refused):
        print(f"{ending}: {read[ending]} read, {refused[ending]} refused")
    print(f"longest {longest:.2f} s; a process at most {largest:.0f} MB")
    print(f"{len(failures)} failures")
    for path, words in failures.items():
        print(f"{path}: {words}")
    sys.exit(bool(failures))
