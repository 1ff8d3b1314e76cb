"""How to diagnose: base, training records, candidates."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from lumbar.settings.improvement import is_data, system_of
from lumbar.settings.layout import ColumnLayout
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.effects.catalogue import CATALOGUES, MOTION_SENSOR, catalogue_with, read_base
from lumbar.tissue.models.bases import CHOSEN_BY_DATA, Base
from lumbar.tissue.models.form import Effect


@dataclass(frozen=True)
class DiagnosisSettings:
    """How to diagnose."""

    base: str | Base = CHOSEN_BY_DATA
    """Base model, a key of `lumbar.tissue.models.bases.BASES`, ``"auto"``: that of a tissue which the data ask for, or one of
    one's own."""
    train: str | Sequence[str] | None = None
    """Training record, or several that are fitted together; None takes the longest."""
    catalogue: dict[str, Effect] | None = None
    """Candidates; default those of the system that the base is a model of."""
    most_effects: int = 3
    """Most effects to add."""
    forward: bool = False
    """Whether the records of a tissue test have the force as input and the motion as output."""
    load_drives: bool = False
    """Whether the load is the records' input, wherever it stands: of such records, and where a base of one's own takes it."""
    propose_law: bool = False
    """Whether a short formula is searched for what no effect explains."""
    session: bool = False
    """Whether the records were cut from one session, in their order."""
    settling_s: float | None = None
    """Seconds at the start of every record that no error counts; None follows the records."""
    layout: ColumnLayout | None = None
    """That the records were read with, for the lines which turn their columns; None is the reference's."""
    force_frame: tuple[float, ...] | None = None
    """How a force sensor of several axes is mounted, as of `lumbar.records.frames.with_force_frame`."""

    @property
    def system(self) -> str:
        """What the base is a model of."""
        return self.base.system if isinstance(self.base, Base) else system_of(self.base)

    @property
    def candidates(self) -> dict[str, Effect]:
        """The catalogue that is given, or that of the base; of forward records with the effects of the motion's sensor."""
        found = CATALOGUES[self.system] if self.catalogue is None else self.catalogue
        return {**found, **MOTION_SENSOR} if self.forward else found

    @property
    def searched(self) -> dict[str, Effect]:
        """The candidates without those that are asked only in the place of what is named."""
        return {name: effect for name, effect in self.candidates.items() if not effect.rival}

    @classmethod
    def from_study(
        cls, settings: StudySettings, base: str | None = None, train: str | Sequence[str] | None = None
    ) -> Self:
        """How a study diagnoses; base and training records that are given come before its own.

        Raises
        ------
        InputError
            For an unknown base, and one of one's own that is not sound.
        """
        improvement = settings.improvement
        base = base or improvement.base
        gravity = settings.stability.pendulum.gravity_m_s2
        chosen = read_base(base) if is_data(base) else base
        load_drives = improvement.forward and system_of(base) == "tissue"
        settling_s = settings.tissue.settling_s
        if settling_s is None and isinstance(chosen, Base) and chosen.form.start:
            settling_s = 0.0  # it says how records begin
        return cls(
            base=chosen,
            train=train or improvement.train,
            catalogue=catalogue_with(improvement.effect_files, base, gravity),
            most_effects=improvement.most_effects,
            # A base of one's own goes from the input to the output, whatever they are: nothing is turned round.
            forward=load_drives and not isinstance(chosen, Base),
            load_drives=load_drives,
            propose_law=improvement.propose_law,
            session=improvement.session,
            settling_s=settling_s,
            layout=settings.tissue.layout,
            force_frame=settings.tissue.force_frame,
        )
