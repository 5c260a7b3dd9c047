"""Workers work, and none outlives the process that started them."""

import os
import signal
import subprocess
import sys
import threading
import time

from mambo_flight import worker_pool as pools
from mambo_flight.worker_pool import worker_pool
from mambo_model.errors import JobError
import pytest

SCRIPT = """
import os
import time
from mambo_flight.worker_pool import worker_pool
if __name__ == '__main__':
    with worker_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 600).result()
"""


def is_running(process):
    try:
        with open(f'/proc/{process}/stat') as file:
            return file.read().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def test_workers_return_results_in_order():
    with worker_pool(2) as pool:
        assert list(pool.map(abs, range(-3, 1))) == [3, 2, 1, 0]


def test_a_worker_that_is_killed_is_one_line():
    with pytest.raises(JobError, match='a worker process was killed'), worker_pool(1) as pool:
        os.kill(pool.submit(os.getpid).result(), signal.SIGKILL)
        pool.submit(abs, 1).result()


def test_a_worker_ends_with_a_parent_that_is_killed(tmp_path):
    script = tmp_path / 'parent.py'
    script.write_text(SCRIPT)
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    try:
        worker = int(parent.stdout.readline())
        assert is_running(worker)
        parent.send_signal(signal.SIGKILL)
        parent.wait()
        limit = time.monotonic() + 60.0
        while is_running(worker) and time.monotonic() < limit:
            time.sleep(0.05)
        assert not is_running(worker)
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()
        if is_running(worker):
            os.kill(worker, signal.SIGKILL)


def test_the_result_does_not_wait_for_work_that_is_not_begun():
    began = time.monotonic()
    with worker_pool(1) as pool:
        jobs = [pool.submit(time.sleep, 0.2) for _ in range(500)]
        jobs[0].result()
    assert time.monotonic() - began < 60.0 and jobs[-1].cancelled()


def test_work_that_never_ends_does_not_hold_up_an_error():
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt), worker_pool(2) as pool:
        number = pool.submit(os.getpid).result()
        pool.submit(sum, range(10**13))
        raise KeyboardInterrupt
    assert time.monotonic() - began < 60.0 and not is_running(number)


def test_a_terminal_that_closes_leaves_no_traceback(tmp_path):
    """The signal goes to all processes; the parent alone answers it."""
    script = tmp_path / 'parent.py'
    script.write_text(SCRIPT.replace('    with', """    import signal
    def stop(*_):
        raise SystemExit(129)
    signal.signal(signal.SIGHUP, stop)
    with""", 1))
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        parent.stdout.readline()
        os.killpg(parent.pid, signal.SIGHUP)
        assert parent.communicate(timeout=60.0) == ('', '') and parent.returncode == 129
    finally:
        parent.kill()
        parent.communicate()


@pytest.mark.long
def test_a_worker_whose_thread_never_ends_is_killed(monkeypatch):
    monkeypatch.setattr(pools, '_EXIT', 0.5)
    with worker_pool(1) as pool:
        number = pool.submit(os.getpid).result()
        pool.submit(start_thread).result()
    assert not is_running(number)


def start_thread():
    threading.Thread(target=time.sleep, args=(600.0,)).start()
