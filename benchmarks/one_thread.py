"""Imported before numerical libraries: one thread of them, as benchmarks count it; and what the project's tests share."""

import os
import sys
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"
PROJECT = Path(__file__).resolve().parents[1]
sys.path[:0] = [
    str(PROJECT / folder) for folder in ("workflow", "tests", "tests/unit", "tests/unit/lifting/movement")
]
