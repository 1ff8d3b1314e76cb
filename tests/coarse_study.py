"""The default study made coarse, for tests: the same steps on less."""

from pathlib import Path

from running import ZIG_CACHE, copy_project


def coarse_project(folder: Path) -> Path:
    """A copy of the project whose default study is coarse."""
    copy_project(folder)
    leave_out_lighter_box(folder)
    coarse = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    (folder / "config" / "coarse.yaml").write_text(
        coarse.replace("ZIG_CACHE", str(ZIG_CACHE)), encoding="utf-8"
    )
    return folder


def leave_out_lighter_box(folder: Path) -> None:
    for path in (folder / "config" / "subjects").glob("*.yaml"):
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(line for line in lines if "box_mass_kg: 15" not in line), encoding="utf-8")
