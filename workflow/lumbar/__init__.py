"""Soft-tissue force-feedback models and lifting stability, from recordings to tables, figures and FMUs.

The functions of the command line and of the workflow, on objects::

    import lumbar

    records = lumbar.read("recordings/tissue")
    diagnosis = lumbar.diagnose(records)
    refined = diagnosis.add("coulomb_friction")
    lumbar.export_fmu(refined.model, "fmu")

    lift = lumbar.lift("expert_23kg.c3d", subject="config/subjects/expert.yaml", box_mass_kg=23)
    print(lumbar.basins(lift))
"""

__version__ = "0.1.0"

_EXPORTS = {
    "InputError": "lumbar.base.errors",
    "LumbarError": "lumbar.base.errors",
    "NumericalError": "lumbar.base.errors",
    "export_fmu": "lumbar.interface.device",
    "export_prony": "lumbar.interface.device",
    "load_models": "lumbar.interface.device",
    "render": "lumbar.interface.device",
    "diagnose": "lumbar.interface.diagnose",
    "propose": "lumbar.interface.diagnose",
    "identify": "lumbar.interface.identification",
    "import_recordings": "lumbar.interface.importing",
    "inspect": "lumbar.interface.inspecting",
    "lift": "lumbar.interface.lift",
    "basins": "lumbar.interface.lift_basins",
    "lift_page": "lumbar.interface.lift_page",
    "measure_movement": "lumbar.interface.movement",
    "new_study": "lumbar.interface.new_study",
    "analyse_survey": "lumbar.interface.people",
    "compare_groups": "lumbar.interface.people",
    "read": "lumbar.interface.reading",
    "compare": "lumbar.interface.comparison",
    "locate": "lumbar.interface.comparison",
    "refine": "lumbar.interface.refinement",
    "report": "lumbar.interface.study_report",
    "bandwidth": "lumbar.interface.surgeons",
    "design_signals": "lumbar.interface.surgeons",
    "Channel": "lumbar.records.record",
    "Record": "lumbar.records.record",
    "RecordSet": "lumbar.records.record",
    "ImprovementSettings": "lumbar.settings.tissue",
    "ColumnLayout": "lumbar.settings.layout",
    "MarkerLayout": "lumbar.settings.layout",
    "SubjectSettings": "lumbar.settings.lifting",
    "StudySettings": "lumbar.settings.study_settings",
    "load_settings": "lumbar.study.load_study",
    "load_subject": "lumbar.study.load_study",
}
"""Module of each public name. A module is imported when one of its names is first used, so ``import lumbar`` is fast.
The stub ``__init__.pyi`` lists the same names for type checkers."""

__all__ = sorted(_EXPORTS)


def __getattr__(name: str):
    if name not in _EXPORTS:
        raise AttributeError(f"module 'lumbar' has no attribute {name!r}; it offers {', '.join(__all__)}")
    from importlib import import_module

    value = getattr(import_module(_EXPORTS[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
