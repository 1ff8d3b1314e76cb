"""What those who build an FMU and those who check it agree on: where it keeps its signals, what it says of itself, which push.

The check plays every FMU in a process of its own: what it needs of the builder lies here, where nothing else is imported.
"""

from __future__ import annotations

import json
from xml.etree.ElementTree import Element

import numpy as np

REFERENCE = ("resources/reference_input.csv", "resources/reference_output.csv")
"""Signals to try an importer with."""
WITHOUT_EVENT_MODE = "resources/reference_output_without_event_mode.csv"
"""What an importer without event mode reads of an FMI 3.0 FMU: what one of FMI 2.0 reads."""
ANNOTATION = "lumbar"
"""Name of the annotation that holds `lumbar.tissue.fmu.build.meaning.meaning`."""
_PUSH = 0.2
"""Seconds of the push that tells which force resists."""


def slow_push(sampling_time: float) -> np.ndarray:
    """Positions (from 0 to 1) of a push whose mean answer tells which force resists: relaxation and friction do not decide."""
    return np.linspace(0.0, 1.0, max(10, round(_PUSH / sampling_time)))


def told_meaning(root: Element) -> dict | None:
    """Return what the annotation of a model description holds; None where there is none that can be read."""
    element = root.find(f"VendorAnnotations/Tool[@name='{ANNOTATION}']/Meaning")
    if element is not None:
        return {key: _value(text) for key, text in element.attrib.items()}
    told = _value(root.findtext(f"Annotations/Annotation[@type='{ANNOTATION}']", ""))
    return told if isinstance(told, dict) else None


def _value(text: str):
    """What is written, as JSON where it is."""
    try:
        return json.loads(text)
    except ValueError:
        return text
