"""A flight with its view: the page is there, and the bag is the same whatever happens to it."""

import hashlib
import threading
import time
import urllib.request

from free_port import free_port
from mambo_bringup.flight import runner
from mambo_bringup.run import main
import pytest


def fly(bag, *words):
    assert main(['--composed', '--no-report', '-o', str(bag), *words]) == 0
    return [hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(bag.glob('*.mcap'))]


@pytest.mark.long
def test_the_bag_is_the_same_with_a_view_without_and_with_one_that_fails(
        tmp_path, monkeypatch, capsys):
    alone = fly(tmp_path / 'alone', '--duration', '4')
    port = str(free_port())
    assert fly(tmp_path / 'seen', '--duration', '4', '--view', port) == alone
    assert f'view: http://127.0.0.1:{port}\n' in capsys.readouterr().out
    monkeypatch.setattr(runner, 'VIEW', ('mambo_bags', 'replay_node'))  # ends: it knows no bag
    assert fly(tmp_path / 'failed', '--duration', '4', '--view', port) == alone
    assert ('the view ended before the flight: replay_node ended with exit code 2: '
            in capsys.readouterr().out)


def test_the_page_answers_while_the_flight_lasts_and_not_after(tmp_path):
    address, answers, over = f'http://127.0.0.1:{free_port()}', [], threading.Event()

    def look():
        while not answers and not over.is_set():
            try:
                with urllib.request.urlopen(address, timeout=5) as page:
                    answers.append(page.status)
            except OSError:
                time.sleep(0.1)
    looking = threading.Thread(target=look)
    looking.start()
    try:
        fly(tmp_path / 'bag', '--mode', 'realtime', '--duration', '8', '--view',
            address.rpartition(':')[2])
    finally:
        over.set()
        looking.join()
    assert answers == [200]
    try:
        urllib.request.urlopen(address, timeout=5)
    except OSError:
        return
    raise AssertionError('the page is still served')
