"""Soft-tissue force-feedback models and lifting stability, from recordings to tables, figures and FMUs.

The verbs of the command line and of the workflow, on objects::

    import lumbar

    records = lumbar.read("recordings/tissue")
    diagnosis = lumbar.diagnose(records)
    refined = diagnosis.add("coulomb_friction")
    lumbar.export_fmu(refined.model, "fmu")

    lift = lumbar.lift("expert_23kg.c3d", subject="config/subjects/expert.yaml", box_mass_kg=23)
    print(lumbar.basins(lift))
"""

__version__ = "0.1.0"

_VERBS = {
    "export_fmu": "lumbar.interface.device",
    "load_models": "lumbar.interface.device",
    "render": "lumbar.interface.device",
    "diagnose": "lumbar.interface.diagnosis",
    "propose": "lumbar.interface.diagnosis",
    "identify": "lumbar.interface.identification",
    "import_recordings": "lumbar.interface.importing",
    "inspect": "lumbar.interface.inspecting",
    "lift": "lumbar.interface.lift",
    "basins": "lumbar.interface.lift_basins",
    "lift_page": "lumbar.interface.lift_page",
    "measure_movement": "lumbar.interface.movement",
    "analyse_survey": "lumbar.interface.participants",
    "compare_groups": "lumbar.interface.people",
    "read": "lumbar.interface.reading",
    "compare": "lumbar.interface.refinement",
    "locate": "lumbar.interface.refinement",
    "refine": "lumbar.interface.refinement",
    "report": "lumbar.interface.study_report",
    "bandwidth": "lumbar.interface.surgeons",
    "design_signals": "lumbar.interface.surgeons",
    "load_settings": "lumbar.study.load_study",
    "load_subject": "lumbar.study.subject_file",
}
"""Where each verb lies: modules are imported when a verb is first used, so that ``import lumbar`` costs nothing. The
stub ``__init__.pyi`` says the same to type checkers."""

__all__ = sorted(_VERBS)


def __getattr__(name: str):
    if name not in _VERBS:
        raise AttributeError(f"module 'lumbar' has no attribute {name!r}; its verbs are {', '.join(__all__)}")
    from importlib import import_module

    verb = getattr(import_module(_VERBS[name]), name)
    globals()[name] = verb
    return verb


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
