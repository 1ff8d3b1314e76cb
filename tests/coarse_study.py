"""The default study made coarse, for tests: the same steps on less."""

from pathlib import Path

from running import ZIG_CACHE, copy_project

# Fewer knots, starts, resamples, effects, FMUs and lifts, fewer records to diagnose, and pictures that are sketched: the same
# steps on less, with checks that the default leaves out. The proof, which would take four times all the rest, is held by tests of
# its own.
COARSE = f"""
surgeon: {{bandwidth: {{resamples: 200}}}}
survey: {{resamples: 1000}}
tissue: {{bootstrap: {{resamples: 100}}}}
runtime: {{compiler_cache: {ZIG_CACHE}, check_samples: 200, models: [IL, KB]}}
stability:
  knots: 101 # with fewer a programme of cvxpy fails
  checks: [simulation, thesis_method, sum_of_squares, cvxpy, extended]
  sum_of_squares: {{knots: 5}}
  thesis_method: {{knots: 5}}
  attack: {{starts: 50}}
  limits: {{knots: 84, certified_knots: 5}}
improvement:
  most_effects: 1
  record_sets:
    - {{name: tissue}}
    - name: hip_moment
      base: pendulum
      records:
        - {{name: paced, file: hip_moment/paced.csv}}
        - {{name: fast, file: hip_moment/fast.csv}}
"""


def coarse_project(folder: Path) -> Path:
    """A copy of the project whose default study is coarse."""
    copy_project(folder)
    leave_out_lighter_box(folder)
    (folder / "config" / "coarse.yaml").write_text(COARSE, encoding="utf-8")
    return folder


def leave_out_lighter_box(folder: Path) -> None:
    for path in (folder / "config" / "subjects").glob("*.yaml"):
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(line for line in lines if "box_mass_kg: 15" not in line), encoding="utf-8")
