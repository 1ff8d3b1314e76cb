"""Plays positions through an FMU with Ecos and prints the forces as hexadecimal floats.

Usage: python play_ecos.py FMU POSITIONS.csv STEP
"""

import csv
import sys
from pathlib import Path

from ecospy import EcosSimulation, EcosSimulationStructure

fmu, positions, step = sys.argv[1:]
with Path(positions).open() as file:
    values = [float(row["position"]) for row in csv.DictReader(file)]
structure = EcosSimulationStructure()
structure.add_model("tissue", fmu)
with EcosSimulation(structure=structure, step_size=float(step)) as simulation:
    simulation.init()
    for value in values:
        simulation.set_real("tissue::position", value)
        simulation.step()
        print(simulation.get_real("tissue::force").hex())
    simulation.terminate()
