"""Commands of the lifting chapters: ``lumbar new-study``, ``lift`` and ``basin``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.files import read_json
from lumbar.cli.options import given_settings

if TYPE_CHECKING:
    from lumbar.interface.lift import Lift


def run_new_study(options) -> None:
    """Look at the recordings, write the files, say what is to be filled in."""
    from lumbar.interface.new_study import new_study

    study = new_study(options.folder, options.name)
    study.save(options.project)
    print(study)


def run_lift(options) -> None:
    """Analyse the lifts, write their pendulums, print their events and, of one, measures and checks of its centres of mass."""
    study = given_settings(options)
    settings = study.lifting
    if len(options.markers) > 1 or options.markers[0].is_dir():
        _run_all(options, study)
        return
    from lumbar.interface.lift import lift
    from lumbar.interface.movement import measure_movement

    found = lift(
        options.markers[0],
        options.subject,
        options.box_mass,
        trial=options.trial,
        settings=settings,
        static=options.static,
        forces=options.forces,
        data=options.data or options.markers[0].name,
    )
    found.save(options.output)
    measures = measure_movement(found, settings=study.stability)
    measures.save(options.output)
    print(found if found.analysed.states else found.seen)  # why there is no pendulum stands at the end
    print(measures)
    print("\n".join(found.checks))
    print("\n".join(_closing(found, options.output)))
    if options.opensim:
        from lumbar.interface.opensim_export import export_opensim

        print("\n".join(export_opensim(found, options.opensim, study.stability.pendulum.gravity_m_s2)))
    if options.page:
        from lumbar.interface.lift_page import lift_page

        lift_page(found, settings=study.stability).save(options.page)
        print(f"{options.page} shows the lift.")
    else:
        print(f"Its page: {_explored(options.output, options)}")


def _explored(folder: Path, options) -> str:
    """The command that shows a folder's lifts under the settings that were given here: a push answers by them."""
    given = [part for path in options.config for part in ("--config", str(path))]
    return shlex.join(["lumbar", "explore", str(folder), *given])


def _closing(found: Lift, output: Path) -> list[str]:
    """Say where the pendulums are, or that there are none and why."""
    if found.analysed.states:
        return [f"pendulum.csv and pendulum.json are in {output}"]
    remedy = (
        "events that the markers do not show are set in the trial: events: {deposit_start_s: …, release_s: …}"
    )
    return [f"no pendulum: pendulum.csv in {output} has no rows", *found.without_pendulum, remedy]


def _run_all(options, study) -> None:
    """Analyse several lifts; end with an error that names those without a result, after the others are written."""
    from lumbar.interface.lift import subject_of
    from lumbar.interface.lift_batch import lift_all, planned_lifts

    if options.trial or options.forces or options.page or options.opensim:
        raise InputError(
            "--trial, --forces, --page and --opensim are those of one lift of one file: give that file alone"
        )
    subject = subject_of(options.subject)
    lifts = planned_lifts(options.markers, subject)
    table, failed = lift_all(
        lifts,
        subject,
        options.box_mass,
        study.lifting,
        options.output,
        options.data,
        options.static,
        study.stability,
    )
    for row in table.itertuples():
        print(f"{row.lift}: {row.pendulums} pendulums" + (f"; {row.remark}" if row.remark else ""))
    print(f"{len(lifts) - len(failed)} lifts, lifts.csv and movement_measures.csv are in {options.output}")
    empty = [row.lift for row in table.itertuples() if not row.pendulums and row.lift not in failed]
    if empty:
        print(f"no pendulum at all: {', '.join(empty)}; why stands above and in lifts.csv")
    if failed:
        raise InputError(
            f"{len(failed)} of {len(lifts)} lifts have no result: {', '.join(failed)}; lifts.csv says why"
        )


def run_basin(options) -> None:
    """Compute and check the basins, write areas and funnels, and end with an error if a basin is missing."""
    from lumbar.interface.lift_basins import basins
    from lumbar.lifting.stability.model.failures import announcement

    settings = given_settings(options)
    facts = read_json(options.facts) if options.facts else None
    found = basins(options.states, facts=facts, settings=settings.stability, seed=settings.seed)
    found.save(options.output)
    if not found.areas.empty:
        print(f"{found}\n{len(found.areas)} basins are in {options.output / 'boa.csv'}")
        print(f"To push the pendulums: {_explored(options.states.parent, options)}")
    if message := announcement(options.output / "failures.csv"):
        raise NumericalError(message)
