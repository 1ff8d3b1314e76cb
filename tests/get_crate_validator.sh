#!/bin/sh
# Sets up rocrate-validator, an independent checker of RO-Crates, in an environment of its own:
#   tests/get_crate_validator.sh FOLDER && LUMBAR_CRATE_VALIDATOR=FOLDER python -m pytest tests/unit/publishing/test_run_crate.py
set -eu
"${PYTHON:-python3}" -m venv "$1"
"$1/bin/python" -m pip install --quiet "roc-validator>=0.13,<1"
