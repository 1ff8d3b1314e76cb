# Named targets: one per chapter and one per artefact.


for chapter in settings.chapters:

    rule:
        name:
            chapter
        input:
            made([artefact for artefact in ARTEFACTS if artefact.chapter == chapter]),


for artefact in ARTEFACTS:

    rule:
        name:
            artefact.id
        input:
            made([artefact]),


onsuccess:
    print(summary(Path("results") / STUDY / "benchmarks"))
    missing = Path("results") / STUDY / "stability" / "failures.csv"
    if study.has("stability") and missing.is_file() and announcement(missing):
        print(announcement(missing))
    print(f"Results of the study {STUDY!r} ({DATA}): results/{STUDY}")
