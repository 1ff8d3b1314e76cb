#!/bin/sh
# Builds fmusim, the FMI project's own simulator (Rust), with cargo from LUMBAR_SHARED/importers/fmusim, which holds the sources of
# https://github.com/modelica/fmusim.
#   tests/get_fmusim.sh FOLDER && LUMBAR_IMPORTERS=FOLDER python -m pytest tests/unit/tissue/fmu/test_runtime_platforms.py
set -eu
mkdir -p "$1/bin"
cd "$1"
cp -R "$LUMBAR_SHARED/importers/fmusim" fmusim-sources
(cd fmusim-sources && cargo build --quiet --release -p fmusim)
cp fmusim-sources/target/release/fmusim bin/
