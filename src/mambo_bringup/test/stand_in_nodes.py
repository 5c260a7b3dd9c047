"""Programs that take the place of the nodes of a flight in tests."""

from mambo_bringup.flight.nodes import FLIGHT_NODES, RECORDER, SIMULATOR
from mambo_flight.scenario import scenario

NODES = [name for _, name in (*FLIGHT_NODES, RECORDER, SIMULATOR)]
STAND_IN = """#!/usr/bin/env python3
import pathlib, shutil, signal, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
here = pathlib.Path(__file__)
shutil.copy(here, here.parent / f'{here.name}.up')
while len(list(here.parent.glob('*.up'))) < NODES:
    time.sleep(0.01)
""".replace('NODES', str(len(NODES)))
QUIET = """
shutil.copy(here, here.parent / f'{here.name}.quiet')
while True:
    time.sleep(0.01)
"""
FLEW = """
while len(list(here.parent.glob('*.quiet'))) < OTHERS:
    time.sleep(0.01)
print('[INFO] [1.0] [mambo.sim_node]: flew 3.000 s in 1.500 s of wall time, '
      '2 steps without their motor command, 3 waited for a late one')
print('[INFO] [1.0] [mambo.sim_node]: IMU sample to motor command: p50 1.00 ms')
""".replace('OTHERS', str(len(NODES) - 1))
COPY = "shutil.copy(sys.argv[-1], f'{here}.yaml')\n"


def short():
    return scenario(duration=3.0, overrides={'sim_node.mode': 'lockstep'})
