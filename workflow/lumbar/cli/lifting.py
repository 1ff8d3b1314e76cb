"""Commands of the lifting chapters: ``lumbar new-study``, ``lift`` and ``basin``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import NumericalError
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
    """Analyse a lift, write its pendulums, print its events, its measures and the checks of its centres of mass."""
    study = given_settings(options)
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
    print(found if found.analysed.states else found.seen)  # why there is no pendulum stands at the end
    print(measures)
    print("\n".join([*found.checks, *_closing(found, options.output)]))
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


def run_basin(options) -> None:
    """Compute and check the basins, write areas and funnels, and end with an error if a basin is missing."""
    from lumbar.interface.lift_basins import basins
    from lumbar.lifting.stability.model.pendulum_trajectories import announcement

    settings = given_settings(options)
    facts = read_json(options.facts) if options.facts else None
    found = basins(options.states, facts=facts, settings=settings.stability, seed=settings.seed)
    found.save(options.output)
    if not found.areas.empty:
        print(f"{found}\n{len(found.areas)} basins are in {options.output / 'boa.csv'}")
        print(f"To push the pendulums: {_explored(options.states.parent, options)}")
    if message := announcement(options.output / "failures.csv"):
        raise NumericalError(message)
