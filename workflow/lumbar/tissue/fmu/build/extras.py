"""What an FMU holds beside model, sources and binaries: icon, terminals, licence, reference signals."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from lumbar.tissue.fmu.agreed import REFERENCE, WITHOUT_EVENT_MODE
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.reference_response import reference_output

_HERE = Path(__file__).parent


def attachments(model: ExportModel, version: str) -> dict[str, bytes]:
    """Return icon, terminals (FMI 3.0) and licence by their paths in the FMU."""
    icon = (_HERE / "icon.png").read_bytes()
    licence = (_HERE / "license.txt").read_bytes().replace(b"\r\n", b"\n")
    files = {"documentation/licenses/license.txt": licence}
    if version == "2.0":
        return {**files, "model.png": icon}
    return {
        **files,
        "terminalsAndIcons/icon.png": icon,
        "terminalsAndIcons/terminalsAndIcons.xml": _terminals(model).encode("utf-8"),
    }


def resources(
    model: ExportModel, version: str, push: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> dict[str, str]:
    """Return the reference signals by their paths in the FMU: what to play and what should come out.

    Parameters
    ----------
    version : str
        Of FMI; FMI 3.0 has a second output, for importers without event mode.
    push : tuple of numpy.ndarray
        Time, input and output, each of shape (samples,).
    """
    time, inputs, outputs = push
    signals = {
        REFERENCE[0]: _signal(time, inputs, model.input.variable),
        REFERENCE[1]: _signal(time, outputs, model.output.variable),
    }
    if version == "3.0":
        late = reference_output(model, inputs, "2.0")
        signals[WITHOUT_EVENT_MODE] = _signal(time, late, model.output.variable)
    return signals


def _signal(time: np.ndarray, values: np.ndarray, name: str) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("time", name))
    writer.writerows(zip(time.tolist(), values.tolist(), strict=True))
    return text.getvalue()


def _terminals(model: ExportModel) -> str:
    """One terminal, the tool: its position goes in, the force on it comes out."""
    root = ElementTree.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = ElementTree.SubElement(root, "GraphicalRepresentation")
    box = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    ElementTree.SubElement(graphics, "CoordinateSystem", {**box, "suggestedScalingFactorTo_mm": "0.1"})
    ElementTree.SubElement(graphics, "Icon", box)
    terminal = ElementTree.SubElement(
        ElementTree.SubElement(root, "Terminals"),
        "Terminal",
        name="tool",
        matchingRule="bus",
        description="The tool that touches the model",
    )
    for name in (model.input.variable, model.output.variable):
        ElementTree.SubElement(
            terminal, "TerminalMemberVariable", variableName=name, memberName=name, variableKind="signal"
        )
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'
