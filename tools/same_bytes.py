#!/usr/bin/env python3
"""
Fly a few short flights in one process and compare every bit with the committed digests.

usage: tools/same_bytes.py [--write | FLIGHT ...]

It needs the packages below ``src`` on the path of Python, with numpy, scipy, numba and PyYAML, but
no ROS, so that it runs on machines that have none. NUMBA_DISABLE_JIT=1 leaves the compiler out:
the flights then take some seconds, and minutes where the compiler makes each for the first time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import hashlib
import json
from pathlib import Path
import platform
import sys
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DIGESTS = ROOT / 'tests/flights/same_bytes.json'
DURATION = 4.0  # s: take-off and half a second of the circle at its full speed

FLIGHTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {  # options and other parameters
    'kalman': ({'estimator': 'kalman'}, {}),
    'joint': ({'estimator': 'joint', 'controller': 'flatness_drag'}, {}),
    'joint on motion capture': (
        {'estimator': 'joint', 'controller': 'indi'},
        {'estimator_node.joint.pose.enabled': True, 'controller_node.estimate': 'map'}),
    'support package': ({'estimator': 'toolbox', 'controller': 'toolbox'}, {}),
    'wind, another drone': (
        {'estimator': 'kalman', 'controller': 'geometric', 'seed': 3},
        {'sim_node.simulator.wind.velocity': (1.0, 0.5, 0.0),
         'sim_node.simulator.wind.gust': (0.5, 0.5, 0.2), 'sim_node.simulator.imu.drone': 7}),
}


def digests(names: Iterable[str] = FLIGHTS) -> dict[str, str]:
    """Return {flight: SHA-256 of everything that the closed loop records} of some flights."""
    from mambo_flight import closed_loop
    from mambo_flight.scenario import scenario
    out = {}
    for name in names:
        options, overrides = FLIGHTS[name]
        recording = closed_loop.fly(scenario(
            duration=DURATION, land=False, overrides=overrides, **options), inner=True)
        out[name] = hashlib.sha256(b''.join(_bytes(recording))).hexdigest()
    return out


def _bytes(value: Any) -> Iterator[bytes]:
    """Yield the bytes of all arrays in nested tuples, in order."""
    if isinstance(value, tuple):
        for one in value:
            yield from _bytes(one)
    elif value is not None:
        yield value.tobytes()


def main(arguments: list[str]) -> int:
    """Compare or write; return the exit code."""
    import numpy
    if arguments == ['--write']:
        DIGESTS.write_text(json.dumps(digests(), indent=2) + '\n')
        return 0
    if unknown := set(arguments) - set(FLIGHTS):
        print(f'same_bytes: {unknown.pop()!r} is none of {", ".join(FLIGHTS)}', file=sys.stderr)
        return 2
    found = digests(arguments or FLIGHTS)
    known = json.loads(DIGESTS.read_text())
    print(f'{platform.machine()}, Python {platform.python_version()}, numpy {numpy.__version__}')
    for name, value in found.items():
        print(f'{"the same" if known.get(name) == value else "DIFFERENT"}  {value[:16]}  {name}')
    return int(not found.items() <= known.items())


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
