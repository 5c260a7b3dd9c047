"""
Run jobs, some of them side by side, and show what they print, line by line; part of ``./test``.

usage: lanes.py AT_ONCE NAME COMMAND [NAME COMMAND ...]

The jobs begin in the order given, each as soon as fewer than AT_ONCE run. Each line of a COMMAND,
a script of bash, is printed as soon as it is complete, behind the NAME of its job. The last line
of a job says how long it took. An interrupt (Ctrl-C, SIGTERM) ends all of them. The exit code is
0 if all ended with 0, 128 plus the signal behind an interrupt, else 1.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time

PATIENCE = 30.0  # s from an interrupt until what has not ended is killed


class Job:
    """
    A command that runs beside others.

    Parameters
    ----------
    name
        Stands before each line.
    command
        A script of bash.
    width
        Of the column of names.

    """

    def __init__(self, name: str, command: str, width: int) -> None:
        self.name, self._width, self._began = name, width, time.monotonic()
        self._process = subprocess.Popen(
            ['bash', '-c', command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors='replace',
            start_new_session=True)  # Ctrl-C comes once, from here
        self._reader = threading.Thread(target=self._show, daemon=True)
        self._reader.start()

    def _show(self) -> None:
        """Print the lines as they come, and how it ended."""
        for line in self._process.stdout:
            self._print(line.rstrip())
        self._print(f'exit code {self._process.wait()} after '
                    f'{time.monotonic() - self._began:.0f} s')

    def _print(self, line: str) -> None:
        """Print a line in one call: lines of two jobs never mix."""
        sys.stdout.write(f'{self.name:{self._width}} | {line}\n')
        sys.stdout.flush()

    def ended(self, seconds: float) -> bool:
        """Wait for the end, at most so long; return whether the command has ended."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(max(seconds, 0.0))
        return self._process.returncode is not None

    def code(self) -> int:
        """Return the exit code of a command that has ended, after all its lines are printed."""
        self._reader.join(5.0)  # longer only if a process outlives it, which count_tests tells
        return self._process.returncode

    def interrupt(self) -> None:
        """End the command and all that it started as by Ctrl-C."""
        if not self.ended(0.0):
            os.killpg(self._process.pid, signal.SIGINT)

    def kill(self) -> None:
        """End the command by force, and what it started in its group."""
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


def run(at_once: int, commands: dict[str, str]) -> int:
    """Run commands, by the names of their jobs; return the exit code of the module."""
    signals: list[int] = []
    before = {number: signal.signal(number, lambda got, _: signals.append(got))
              for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        width, failed = max(map(len, commands)), False
        waiting, running = list(commands.items()), []
        while (waiting or running) and not signals:
            while waiting and len(running) < at_once:
                running.append(Job(*waiting.pop(0), width))
            running[0].ended(0.1)
            for job in [job for job in running if job.ended(0.0)]:
                running.remove(job)
                failed |= job.code() != 0
        if not signals:
            return int(failed)
        for job in running:
            job.interrupt()
        limit = time.monotonic() + PATIENCE
        for job in running:
            if not job.ended(limit - time.monotonic()):
                job.kill()
        return 128 + signals[0]
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


if __name__ == '__main__':
    sys.exit(run(int(sys.argv[1]), dict(zip(sys.argv[2::2], sys.argv[3::2], strict=True))))
