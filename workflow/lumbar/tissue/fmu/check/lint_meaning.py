"""What an FMU says of itself: direction, valid range, who made it; the same in annotation, description and page."""

from __future__ import annotations

from collections.abc import Mapping
from html import unescape
from xml.etree.ElementTree import Element

from lumbar.tissue.fmu.conventions import ANNOTATION, told_meaning
from lumbar.tissue.models.model_data import MotionRange

_ROOT = ("description", "author", "version", "license", "generationTool")
_NUMBERS = ("lowest", "highest", "speed", "lowest_Hz", "highest_Hz")


def lint_meaning(files: Mapping[str, bytes], root: Element, unit: str | None) -> list[str]:
    """Return what is not said, or said in two ways.

    Parameters
    ----------
    root : Element
        Of the model description.
    unit : str or None
        Of the input.
    """
    problems = [f"modelDescription.xml has no {name}" for name in _ROOT if not root.get(name)]
    token = root.get("guid") or root.get("instantiationToken") or ""
    if root.get("version") and not root.get("version", "").endswith(f"+{token[:8]}"):
        problems.append(
            f"version is {root.get('version')}; it must end with +{token[:8]}, as the token begins"
        )
    told = told_meaning(root)
    if told is None:
        return [*problems, f"there is no annotation {ANNOTATION!r}: direction and valid range are not said"]
    if told.get("resisting_sign") not in (1, -1):
        problems.append(
            f"resisting_sign is {told.get('resisting_sign')!r} in the annotation; 1 or -1 is needed"
        )
    output = next((item for item in root.iter() if item.get("causality") == "output"), root)
    if ("where positive it resists" in output.get("description", "")) != (told.get("resisting_sign") == 1):
        problems.append(
            f"{output.get('name')}: its description says {output.get('description')!r}; the annotation has resisting_sign "
            f"{told.get('resisting_sign')!r}"
        )
    texts = {
        "modelDescription.xml": root.get("description", ""),
        "documentation/index.html": unescape(
            files.get("documentation/index.html", b"").decode("utf-8", errors="replace")
        ),
    }
    for place, text in texts.items():
        if ("INVERTED" in text) != (told.get("resisting_sign") == -1):
            said = "calls the force inverted" if "INVERTED" in text else "does not call the force inverted"
            problems.append(
                f"{place} {said}; the annotation has resisting_sign {told.get('resisting_sign')!r}"
            )
    return problems + _lint_range(told, texts, unit)


def _lint_range(told: dict, texts: Mapping[str, str], unit: str | None) -> list[str]:
    if not any(name in told for name in _NUMBERS):
        words = "Valid range: not known"
    else:
        numbers = [told.get(name) for name in _NUMBERS]
        if not all(isinstance(value, int | float) for value in numbers):
            found = ", ".join(f"{name} {told.get(name)!r}" for name in _NUMBERS)
            return [f"the valid range in the annotation is {found}; numbers are needed"]
        motion = MotionRange(*numbers)
        if not (
            motion.lowest <= motion.highest and motion.lowest_Hz <= motion.highest_Hz and motion.speed >= 0
        ):
            return [f"the valid range in the annotation is {motion.in_words(str(unit))}; no motion is"]
        if told.get("unit") != unit:
            return [f"the valid range in the annotation is in {told.get('unit')!r}; the input is in {unit!r}"]
        words = motion.in_words(str(unit))
    return [
        f"{place} does not say {words!r}, as the annotation does"
        for place, text in texts.items()
        if words not in text
    ]
