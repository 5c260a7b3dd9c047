"""Which flight is meant: the one that runs, or the one that the user names."""

import fcntl

from mambo_model.errors import InputError
from mambo_ros.graph import domains
import pytest


@pytest.fixture
def locks(monkeypatch, tmp_path):
    """Lock domains as flights do; return the function that does it."""
    monkeypatch.setattr(domains.tempfile, 'gettempdir', lambda: str(tmp_path))
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)
    held = []

    def lock(number):
        held.append(domains.lock_path(number).open('w'))
        fcntl.flock(held[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
    yield lock
    for file in held:
        file.close()


def test_a_flight_that_runs_is_found_and_the_file_of_one_that_ended_is_not(locks):
    domains.lock_path(3).touch()
    assert domains.running() == [] and domains.chosen() == 0
    locks(7)
    assert domains.running() == [7] and domains.chosen() == 7


def test_of_several_flights_one_must_be_chosen(locks, monkeypatch):
    locks(2)
    locks(11)
    with pytest.raises(InputError, match='domains 2, 11: choose one with ROS_DOMAIN_ID'):
        domains.chosen()
    monkeypatch.setenv('ROS_DOMAIN_ID', '11')
    assert domains.chosen() == 11


@pytest.mark.parametrize('asked', ['x', '-1', '233', '٣'])
def test_what_is_no_domain_is_refused(locks, monkeypatch, asked):
    monkeypatch.setenv('ROS_DOMAIN_ID', asked)
    with pytest.raises(InputError, match='is not a whole number from 0 to 232'):
        domains.chosen()
