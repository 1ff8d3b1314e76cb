"""Public names of ``lumbar``, for type checkers. The package imports them when they are first used."""

from lumbar.base.errors import InputError as InputError
from lumbar.base.errors import LumbarError as LumbarError
from lumbar.base.errors import NumericalError as NumericalError
from lumbar.interface.comparison import compare as compare
from lumbar.interface.comparison import locate as locate
from lumbar.interface.device import export_fmu as export_fmu
from lumbar.interface.device import export_prony as export_prony
from lumbar.interface.device import load_models as load_models
from lumbar.interface.device import render as render
from lumbar.interface.diagnose import diagnose as diagnose
from lumbar.interface.diagnose import propose as propose
from lumbar.interface.identification import identify as identify
from lumbar.interface.importing import import_recordings as import_recordings
from lumbar.interface.inspecting import inspect as inspect
from lumbar.interface.lift import lift as lift
from lumbar.interface.lift_basins import basins as basins
from lumbar.interface.lift_page import lift_page as lift_page
from lumbar.interface.movement import measure_movement as measure_movement
from lumbar.interface.new_study import new_study as new_study
from lumbar.interface.people import analyse_survey as analyse_survey
from lumbar.interface.people import compare_groups as compare_groups
from lumbar.interface.reading import read as read
from lumbar.interface.refinement import refine as refine
from lumbar.interface.study_report import report as report
from lumbar.interface.surgeons import bandwidth as bandwidth
from lumbar.interface.surgeons import design_signals as design_signals
from lumbar.records.record import Channel as Channel
from lumbar.records.record import Record as Record
from lumbar.records.record import RecordSet as RecordSet
from lumbar.settings.layout import ColumnLayout as ColumnLayout
from lumbar.settings.layout import MarkerLayout as MarkerLayout
from lumbar.settings.lifting import SubjectSettings as SubjectSettings
from lumbar.settings.study_settings import StudySettings as StudySettings
from lumbar.settings.tissue import ImprovementSettings as ImprovementSettings
from lumbar.study.load_study import load_settings as load_settings
from lumbar.study.load_study import load_subject as load_subject

__version__: str
