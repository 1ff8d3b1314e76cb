#!/bin/sh
# Fetches importers of FMUs that have nothing in common with fmpy: libcosim and Ecos (C++) and FMI4j (Java). Needs pip;
# without mvn FMI4j is left out. fmusim, the FMI project's own simulator (Rust), is built with cargo where
# LUMBAR_SHARED/importers/fmusim holds its sources, those of https://github.com/modelica/fmusim.
#   tests/get_importers.sh FOLDER && LUMBAR_IMPORTERS=FOLDER python -m pytest tests/unit/tissue/fmu/test_runtime_platforms.py
set -eu
mkdir -p "$1"
cd "$1"
folder=$PWD
python3 -m venv python
python/bin/pip install --quiet libcosimpy==0.0.6 ecospy==0.7.2 tbb==2023.2.0
if command -v mvn > /dev/null; then
    cat > pom.xml <<END
<project xmlns="http://maven.apache.org/POM/4.0.0">
  <modelVersion>4.0.0</modelVersion>
  <groupId>lumbar</groupId><artifactId>importers</artifactId><version>1</version>
  <dependencies><dependency>
    <groupId>info.laht.fmi4j</groupId><artifactId>fmi-import</artifactId><version>0.38.0</version>
  </dependency></dependencies>
</project>
END
    mvn --quiet --batch-mode dependency:copy-dependencies -DoutputDirectory=jars
fi
if command -v cargo > /dev/null && [ -d "${LUMBAR_SHARED:-}/importers/fmusim" ]; then
    mkdir -p bin
    cp -R "$LUMBAR_SHARED/importers/fmusim" fmusim-sources
    (cd fmusim-sources && cargo build --quiet --release -p fmusim)
    cp fmusim-sources/target/release/fmusim bin/
fi
