#!/bin/sh
# Fetches VDMCheck2, an independent checker of FMI 2.0 files, with Maven and lays it out as it wants to be started:
#   tests/get_vdmcheck.sh FOLDER && VDMCHECK2=FOLDER python -m pytest tests/unit/tissue/fmu/test_runtime_defects.py
set -eu
folder=$1
version=1.1.3
mkdir -p "$folder"
cd "$folder"
cat > pom.xml <<END
<project xmlns="http://maven.apache.org/POM/4.0.0">
  <modelVersion>4.0.0</modelVersion>
  <groupId>lumbar</groupId><artifactId>checks</artifactId><version>1</version>
  <dependencies><dependency>
    <groupId>org.into-cps.vdmcheck.fmi2</groupId><artifactId>vdmcheck2</artifactId><version>$version</version>
  </dependency></dependencies>
</project>
END
mvn --quiet --batch-mode dependency:copy-dependencies -DoutputDirectory=. -Dmdep.stripVersion=true
for jar in static-model rule-model vdmcheck2; do
    unzip -qo "$jar.jar" 'fmi2*' || true
done
