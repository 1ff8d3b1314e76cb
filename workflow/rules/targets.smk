# Named targets: one per chapter, one per artefact, and all of them.


rule all:
    default_target: True
    input:
        [f"<results>/{path}" for artefact in ARTEFACTS for path in artefact.paths(study.lifts)],
        "<results>/run_config.yaml",


for chapter in study.config["chapters"]:

    rule:
        name:
            chapter
        input:
            [f"<results>/{path}" for artefact in ARTEFACTS if artefact.chapter == chapter for path in artefact.paths(study.lifts)],


for artefact in ARTEFACTS:

    rule:
        name:
            artefact.id
        input:
            [f"<results>/{path}" for path in artefact.paths(study.lifts)],
