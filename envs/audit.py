"""The locked versions against the vulnerabilities that are known today, and in words what nobody gave an answer for.

``make audit`` runs it in an environment of its own, that of audit-lock.txt. pip-audit asks PyPI. Where that has no answer
pip-audit says "no known vulnerabilities", or ends with a traceback; here that is named as not run.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
LOCKS = ("lock.txt", "cluster-lock.txt", "audit-lock.txt")
AUDIT = (
    "-m",
    "pip_audit",
    "--disable-pip",
    "--require-hashes",
    "--progress-spinner",
    "off",
    "--format",
    "json",
)


def verdict(name: str, answer: str) -> tuple[list[str], list[str]]:
    """Read pip-audit's answer on a lock.

    Parameters
    ----------
    name : str
        Of the lock.
    answer : str
        JSON; anything else is no answer.

    Returns
    -------
    known : list of str
        A line for every known vulnerability.
    unanswered : list of str
        What was not looked up.
    """
    try:
        packages = json.loads(answer)["dependencies"]
    except (ValueError, KeyError, TypeError):
        return [], [f"{name}: no answer"]
    known = [
        f"{name}: {item['name']} {item['version']}: {found['id']}, mended in {', '.join(found['fix_versions']) or 'no version'}"
        for item in packages
        for found in item.get("vulns", [])
    ]
    skipped = [item["name"] for item in packages if "skip_reason" in item]
    return known, [f"{name}: no answer on {', '.join(skipped)}"] if skipped else []


def main() -> int:
    """Audit every lock; 1 where a vulnerability is known."""
    known, unanswered = [], []
    for name in LOCKS:
        command = [sys.executable, *AUDIT, "--requirement", str(FOLDER / name)]
        answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False).stdout
        for found, all_found in zip(verdict(name, answer), (known, unanswered), strict=True):
            all_found += found
    marked = "::warning title=audit not run::" if os.environ.get("GITHUB_ACTIONS") else ""
    for words in unanswered:
        print(f"{marked}not run: {words}")
    if known or not unanswered:
        print("\n".join(known) or "no vulnerability is known")
    return 1 if known else 0


if __name__ == "__main__":
    sys.exit(main())
