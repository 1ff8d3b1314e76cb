"""``lumbar lift``: from markers to the pendulums of one lift."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_data, add_output, new_command
from lumbar.config.settings_files import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "lift",
        "events, centres of mass and pendulum states of one lift",
        "lumbar lift expert_23kg.c3d --subject config/subjects/expert.yaml --box-mass 23 --output out",
    )
    parser.add_argument("markers", type=Path, metavar="MARKERS", help="C3D or TRC file")
    parser.add_argument("--subject", type=Path, required=True, metavar="YAML", help="as in config/subjects")
    parser.add_argument("--box-mass", type=float, required=True, metavar="KG", help="mass of the box")
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Analyse the lift, write its pendulums, print its events and the checks of its centres of mass."""
    from lumbar.interface.person import lift

    settings, data = load_settings(*options.config).lifting, options.data or options.markers.name
    found = lift(options.markers, options.subject, options.box_mass, settings=settings, data=data)
    found.save(options.output)
    print(found)
    print("\n".join(found.checks))
    print(f"pendulum.csv and pendulum.json are in {options.output}")
