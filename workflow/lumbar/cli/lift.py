"""``lumbar lift``: from markers to the pendulums of one lift."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_data, add_output, load_settings, load_subject, new_command


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
    """Analyse the lift, write its pendulums, print its events."""
    from lumbar.errors import InputError
    from lumbar.files import write_csv, write_json
    from lumbar.lifting import lift as lifting
    from lumbar.records.markers import read_markers
    from lumbar.settings.subject import TrialSettings

    settings = load_settings(options.config).lifting
    subject = load_subject(options.subject)
    if not 0 <= options.box_mass <= 100:
        raise InputError(f"--box-mass is {options.box_mass:g} kg; allowed: 0 to 100")
    # Events declared by hand in the subject's file hold for the lift with this box only.
    declared = [trial for trial in subject.trials if trial.box_mass_kg == options.box_mass]
    trial = declared[0] if declared else TrialSettings(options.box_mass, str(options.markers))
    name = f"{subject.name}_{options.box_mass:g}kg"
    recording = read_markers(options.markers, settings.markers, name=name)
    lift = lifting.analyse_lift(recording, name, subject, trial, settings)
    label = {"data": options.data or options.markers.name}
    write_csv(options.output / "pendulum.csv", lifting.states_frame(lift).assign(**label))
    write_json(options.output / "pendulum.json", {**lifting.summary(lift, subject, trial, settings), **label})
    write_csv(options.output / "centres.csv", lifting.centres_frame(lift).assign(**label))
    for name, event in lift.events.items():
        time = event.as_dict()["time_s"]
        print(f"{name}: " + (f"{time:.3f} s" if time is not None else "none"))
    print(f"pendulum.csv and pendulum.json are in {options.output}")
