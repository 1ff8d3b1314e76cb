"""Settings of a diagnosis: base, training records, candidates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from lumbar.settings.layout import ColumnLayout
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import is_data, system_of
from lumbar.tissue.effects.catalogue import CATALOGUES, MOTION_SENSOR, catalogue_with, read_base
from lumbar.tissue.models.bases import CHOSEN_BY_DATA, Base
from lumbar.tissue.models.form import Effect


@dataclass(frozen=True)
class DiagnosisSettings:
    """Settings of a diagnosis."""

    base: str | Base = CHOSEN_BY_DATA
    """Base model: a key of `lumbar.tissue.models.bases.BASES`, ``"auto"`` to let the data choose, or a user-defined one."""
    train: str | Sequence[str] | None = None
    """Name of the training record, or of several that are fitted together; None selects the longest."""
    catalogue: dict[str, Effect] | None = None
    """Candidate effects; None selects the catalogue of the base's system."""
    most_effects: int = 3
    """Largest number of effects to add."""
    forward: bool = False
    """True if the records of a tissue test have the force as input and the motion as output."""
    load_drives: bool = False
    """True if the load is the input of the records: with `forward`, and for a user-defined base with the load as input."""
    propose_law: bool = False
    """True to search a short formula for the error that no effect explains."""
    session: bool = False
    """True if the records were cut from one session, in their order."""
    settling_s: float | None = None
    """Seconds at the start of every record that are excluded from all errors; None derives them from the records."""
    layout: ColumnLayout | None = None
    """Column layout of the files of the records, for proposed corrections; None is the reference layout."""
    force_frame: tuple[float, ...] | None = None
    """Rotation of a force sensor of several axes; see `lumbar.records.sampling.rotate_forces`."""

    @property
    def system(self) -> str:
        """System of the base: tissue or pendulum."""
        return self.base.system if isinstance(self.base, Base) else system_of(self.base)

    @property
    def candidates(self) -> dict[str, Effect]:
        """Candidate effects, with the effects of the motion sensor if the force is the input."""
        catalogue = CATALOGUES[self.system] if self.catalogue is None else self.catalogue
        return {**catalogue, **MOTION_SENSOR} if self.forward else catalogue

    @property
    def searched(self) -> dict[str, Effect]:
        """Candidate effects without effects that are only tried as rivals of a named effect."""
        return {name: effect for name, effect in self.candidates.items() if not effect.rival}

    @property
    def preparation(self) -> dict[str, Any]:
        """Arguments of `lumbar.tissue.diagnosis.fitting.preparation.prepare`."""
        return {"train": self.train, "session": self.session, "settling_s": self.settling_s}

    def limit(self, catalogue: dict[str, Effect], most_effects: int | None = None) -> Self:
        """Return the settings with fewer candidate effects, or fewer that may be added.

        Parameters
        ----------
        catalogue : dict of str to Effect
            Candidate effects.
        most_effects : int, optional
            Largest number of effects to add; default unchanged.
        """
        return replace(self, catalogue=catalogue, most_effects=most_effects or self.most_effects)

    @classmethod
    def from_study(
        cls, settings: StudySettings, base: str | None = None, train: str | Sequence[str] | None = None
    ) -> Self:
        """Return the settings of a study; `base` and `train` take precedence.

        Raises
        ------
        InputError
            If the base is unknown or invalid.
        """
        improvement = settings.improvement
        base = base or improvement.base
        gravity = settings.stability.pendulum.gravity_m_s2
        chosen = read_base(base) if is_data(base) else base
        load_drives = improvement.forward and system_of(base) == "tissue"
        settling_s = settings.tissue.settling_s
        if settling_s is None and isinstance(chosen, Base) and chosen.form.start:
            settling_s = 0.0  # its initial state is defined
        return cls(
            base=chosen,
            train=train or improvement.train,
            catalogue=catalogue_with(improvement.effect_files, base, gravity),
            most_effects=improvement.most_effects,
            # A user-defined base has its own input and output: nothing is exchanged.
            forward=load_drives and not isinstance(chosen, Base),
            load_drives=load_drives,
            propose_law=improvement.propose_law,
            session=improvement.session,
            settling_s=settling_s,
            layout=settings.tissue.layout,
            force_frame=settings.tissue.force_frame,
        )
