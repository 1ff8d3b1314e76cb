"""False alarms of healthy sensors, and the size from which each fault is detected.

python benchmarks/sensor_faults.py [--records 1000] [--repeats 5]
"""

from __future__ import annotations

import argparse
from collections import Counter

from lumbar.tissue.diagnosis.sensors.sensor_faults import repair
from sensor_records import clean_records, tissue_record

SIZES = {
    "noise": (3e-4, 1e-3, 3e-3, 8e-3, 3e-2),
    "low_passed_noise": (1e-3, 3e-3, 8e-3, 3e-2),
    "steps": (1e-3, 3e-3, 1e-2, 3e-2, 1e-1),
    "jitter": (3e-5, 1e-4, 3e-4, 1e-3),
    "shared_jitter": (3e-5, 1e-4, 3e-4, 1e-3),
    "skew": (1e-5, 2e-5, 5e-5, 1.5e-4, 1e-3),
    "dropped": (5e-4, 2e-3),
    "held": (2e-3, 1e-2),
    "held_force": (2e-3, 1e-2),
}
KIND = {
    "noise": "position_noise", "low_passed_noise": "position_noise", "steps": "quantisation", "jitter": "jitter",
    "shared_jitter": "jitter", "skew": "clock_skew", "dropped": "dropped_samples", "held": "held_samples",
    "held_force": "held_samples",
}  # fmt: skip

EFFECTS = ("none", "hardening", "coulomb", "quadratic_damping", "softening")


def false_alarms(count: int) -> None:
    """Print how many sound records are accused, by kind of fault."""
    accused: Counter = Counter()
    for record in clean_records(count):
        for finding in repair([record])[1]:
            accused[finding.kind] += 1
            print(
                f"  accused: {record.name}, {record.duration:g} s at {1 / record.sampling_time:g} Hz: {finding.sentence}"
            )
    print(f"of {count} sound records accused: {dict(accused) or 'none'}")


def detected(repeats: int) -> None:
    """Print the size from which a fault is detected by kind of motion, and other findings."""
    for fault, sizes in SIZES.items():
        for kind, seconds in (("multisine", 100.0), ("shot", 20.0), ("chirp", 10.0), ("smooth_hold", 30.0)):
            cells = []
            for size in sizes:
                records = [
                    tissue_record(kind, effect, seed=seed, seconds=seconds, fault=fault, size=size)
                    for seed, effect in enumerate(EFFECTS[:repeats])
                ]
                kinds = [[(item.kind, item.value) for item in repair([record])[1]] for record in records]
                right = [value for found in kinds for name, value in found if name == KIND[fault]]
                wrong = sum(name != KIND[fault] for found in kinds for name, _ in found)
                mean = f" ({sum(right) / len(right):.3g})" if right else ""
                cells.append(
                    f"{size:g}: {len(right)}/{len(kinds)}{mean}" + (f" +{wrong} other" if wrong else "")
                )
            print(f"{fault:17s} {kind:12s} {'; '.join(cells)}")


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=1000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    false_alarms(options.records)
    detected(options.repeats)


if __name__ == "__main__":
    main()
