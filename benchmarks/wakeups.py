"""
How late the machine wakes a process of real-time priority that only sleeps, on every core.

``PYTHONPATH=. python3 -m benchmarks.wakeups [--seconds N]``, as root. What it prints bounds what a
graph in real time can keep: a step of 5 ms passes through five processes, each of which is woken.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
import os
import time

PERIOD = 0.001  # s of each sleep
LATE = 0.002    # s


def delays(core: int, seconds: float) -> tuple[int, list[float]]:
    """Return how often a process slept on a core, and each delay beyond LATE in s."""
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    slept, late, now = 0, [], time.monotonic()
    end = now + seconds
    while now < end:
        time.sleep(PERIOD)
        began, now = now, time.monotonic()
        slept += 1
        if now - began - PERIOD > LATE:
            late.append(now - began - PERIOD)
    return slept, late


def main() -> None:
    """Measure all cores at once; print a line for each."""
    out = argparse.ArgumentParser('wakeups', description=__doc__)
    out.add_argument('--seconds', type=float, default=60.0, help='default: 60')
    seconds = out.parse_args().seconds
    cores = sorted(os.sched_getaffinity(0))
    with ProcessPoolExecutor(len(cores)) as pool:
        found = list(pool.map(delays, cores, [seconds] * len(cores)))
    for core, (slept, late) in zip(cores, found, strict=True):
        print(f'core {core}: {len(late)} of {slept} sleeps more than {1e3 * LATE:g} ms late, the '
              f'longest {1e3 * max(late, default=0.0):.1f} ms')


if __name__ == '__main__':
    main()
