"""Plays positions through an FMU with libcosim (Open Simulation Platform) and prints the forces as hexadecimal floats.

Usage: python play_libcosim.py FMU POSITIONS.csv STEP
"""

import csv
import sys
from fractions import Fraction
from pathlib import Path

from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

POSITION, FORCE = 1, 2
fmu, positions, step = sys.argv[1:]
with Path(positions).open() as file:
    values = [float(row["position"]) for row in csv.DictReader(file)]
execution = CosimExecution.from_step_size(int(Fraction(step) * 10**9))
slave = execution.add_local_slave(CosimLocalSlave(fmu_path=fmu, instance_name="tissue"))
manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
execution.add_manipulator(manipulator)
execution.add_observer(observer)
execution.real_initial_value(slave, POSITION, values[0])
for value in values:
    assert manipulator.slave_real_values(slave, [POSITION], [value])
    assert execution.step(), "libcosim could not take a step"
    print(observer.last_real_values(slave, [FORCE])[0].hex())
