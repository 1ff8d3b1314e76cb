"""Commands of the lifting chapters: ``lumbar new-study``, ``lift`` and ``basin``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import NumericalError
from lumbar.base.files import read_json
from lumbar.cli.command import read_settings

if TYPE_CHECKING:
    pass


def run_new_study(options) -> None:
    """Inspect the recordings, write the files, print what to fill in."""
    from lumbar.interface.new_study import new_study

    study = new_study(options.folder, options.name)
    study.save(options.project)
    print(study)


def run_lift(options) -> None:
    """Analyse a lift, write its pendulums, print its events, its measures and the checks of its centres of mass."""
    study = read_settings(options)
    from lumbar.interface.lift import lift
    from lumbar.interface.movement import measure_movement

    found = lift(
        options.markers,
        options.subject,
        options.box_mass,
        trial=options.trial,
        settings=study.lifting,
        static=options.static,
        source_label=options.data or options.markers.name,
    )
    found.save(options.output)
    measures = measure_movement(found, settings=study.stability)
    measures.save(options.output)
    print(found if found.analysed.states else found.seen)  # reasons for missing pendulums are printed last
    print(measures)
    lines = [*found.checks, f"pendulum.csv and pendulum.json are in {options.output}"]
    if not found.analysed.states:
        lines[-1] = f"no pendulum: pendulum.csv in {options.output} has no rows"
        lines += found.without_pendulum
        lines.append(
            "set events that the markers do not show in the trial: events: {deposit_start_s: …, release_s: …}"
        )
    print("\n".join(lines))
    if options.page:
        from lumbar.interface.lift_page import lift_page

        lift_page(found, settings=study.stability).save(options.page)
        print(f"{options.page} shows the lift.")
    else:
        print(f"Its page: {_explored(options.output, options)}")


def _explored(folder: Path, options) -> str:
    """Return the command that shows a folder's lifts with the same settings."""
    given = [part for path in options.config for part in ("--config", str(path))]
    return shlex.join(["lumbar", "explore", str(folder), *given])


def run_basin(options) -> None:
    """Compute and check the basins, write areas and funnels, and end with an error if a basin is missing."""
    from lumbar.interface.lift_basins import basins
    from lumbar.lifting.stability.model.pendulum_trajectories import announcement

    settings = read_settings(options)
    facts = read_json(options.facts) if options.facts else None
    found = basins(options.states, facts=facts, settings=settings.stability, seed=settings.seed)
    found.save(options.output)
    if not found.areas.empty:
        print(f"{found}\n{len(found.areas)} basins are in {options.output / 'boa.csv'}")
        print(f"To push the pendulums: {_explored(options.states.parent, options)}")
    if message := announcement(options.output / "failures.csv"):
        raise NumericalError(message)
