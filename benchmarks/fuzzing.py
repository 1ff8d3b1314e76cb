"""How readers take broken files: 20,000 of them, or as many as are asked for.

    python benchmarks/fuzzing.py [COUNT [SEED]]

Prints how many were read and refused by kind, the longest time and the largest memory; files that ended in another error
than a refusal are kept and named.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(PROJECT / "tests" / "unit"), str(PROJECT / "workflow")]

if __name__ == "__main__":
    from fuzzed_files import read_changed

    count, seed = (*map(int, sys.argv[1:3]), *(20_000, 1)[len(sys.argv) - 1 :])
    outcome = read_changed(Path(tempfile.mkdtemp(prefix="fuzzed_")), count, seed)
    for ending in sorted(outcome.read | outcome.refused):
        print(f"{ending}: {outcome.read[ending]} read, {outcome.refused[ending]} refused")
    print(f"longest {outcome.longest_s:.2f} s; process at most {outcome.largest_MB:.0f} MB")
    print("\n".join([f"{len(outcome.failures)} failures", *outcome.failures[:50]]))
    sys.exit(bool(outcome.failures))
