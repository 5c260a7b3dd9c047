"""Settings of the environment that end a library with a traceback, or the whole process."""

from __future__ import annotations

import os
from pathlib import Path
import resource
import sys
import threading

_MEMORY = 1_000_000_000  # bytes of address space; with less, libraries in C end the process
_FEW = 1000  # processes and threads; a system that does not limit its users allows thousands
_LATEST = 253_402_300_799  # s, the end of the year 9999


def complaint(ros: bool = False) -> str:
    """
    Return what is wrong with the environment in one line; empty: nothing.

    To be called before numpy, matplotlib and ROS are imported.

    Parameters
    ----------
    ros
        Whether ROS will be used.

    """
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < _MEMORY:
        return (f'the limit of memory, {limit // 1_000_000} MB, is too low: set it to '
                f'{_MEMORY // 1_000_000} MB or more (ulimit -v)')
    if (missing := _missing_threads()):
        return (f'{missing} of {len(os.sched_getaffinity(0))} threads, one for each processor, '
                'cannot be started: allow more processes and threads (ulimit -u), or end others')
    if sys.flags.optimize > 1:
        return ('Python without docstrings, of which help texts are made, cannot be used: unset '
                'PYTHONOPTIMIZE, or set it to 1')
    threads = os.environ.get('NUMBA_NUM_THREADS')
    if threads is not None and not (_is_whole(threads) and int(threads) > 0):
        return (f'NUMBA_NUM_THREADS={threads[:40]!r} must be a whole number of threads, 1 or '
                'more: set or unset it')
    date = os.environ.get('SOURCE_DATE_EPOCH')
    if date is not None and not (_is_whole(date) and int(date) <= _LATEST):
        return (f'SOURCE_DATE_EPOCH={date[:40]!r} must be a whole number of seconds since 1970: '
                'set or unset it')
    wanted, known = os.environ.get('RMW_IMPLEMENTATION', ''), _middlewares() if ros else []
    if wanted and known and wanted not in known:
        return (f'RMW_IMPLEMENTATION={wanted[:40]!r} is not installed: unset it, or set it to '
                f'{" or ".join(known)}')
    return ''


def _is_whole(text: str) -> bool:
    """Return whether a text is a whole number of at most 15 digits, without a sign."""
    return text.isascii() and text.isdigit() and len(text) < 16


def _missing_threads() -> int:
    """Return how many threads cannot be started of those that OpenBLAS starts when imported."""
    done, threads = threading.Event(), []
    try:
        for _ in os.sched_getaffinity(0):
            threads.append(threading.Thread(target=done.wait))
            threads[-1].start()
    except RuntimeError:
        threads.pop()
    finally:
        done.set()
        for each in threads:
            each.join()
    return len(os.sched_getaffinity(0)) - len(threads)


def low_limits() -> str:
    """Return which limits of this process are low, to follow on a sentence; '' if none is."""
    memory, count = (resource.getrlimit(kind)[0]
                     for kind in (resource.RLIMIT_AS, resource.RLIMIT_NPROC))
    said = []
    if memory != resource.RLIM_INFINITY:
        said.append(f'memory to {memory // 1_000_000} MB (ulimit -v)')
    if count != resource.RLIM_INFINITY and count < _FEW:
        said.append(f'processes and threads to {count} (ulimit -u)')
    return f'; this shell limits {" and ".join(said)}' if said else ''


def _middlewares() -> list[str]:
    """Return the implementations of the middleware that are installed; empty: not known."""
    found = set()
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        folder = Path(prefix, 'share/ament_index/resource_index/rmw_typesupport')
        try:
            found |= {file.name for file in folder.iterdir()}
        except OSError:
            continue
    return sorted(found - {'rmw_implementation'})
