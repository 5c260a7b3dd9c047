"""Which flight is meant: the one that runs, or the one that the user names."""

import tempfile

from mambo_model.errors import InputError
from mambo_ros.graph import domains
import pytest


@pytest.fixture
def claimed(monkeypatch, tmp_path):
    """Reserve domains as flights do; return the function that does it."""
    monkeypatch.setattr(domains, '_NAME', f'\0{tmp_path}_')
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)
    held = []

    def claim(number):
        held.append(domains.claim(number))
        return held[-1]
    yield claim
    for socket in filter(None, held):
        socket.close()


def test_a_flight_that_runs_is_found_and_one_that_ended_is_not(claimed):
    claimed(3).close()
    assert domains.running() == [] and domains.chosen() == 0
    claimed(7)
    assert domains.running() == [7] and domains.chosen() == 7


def test_a_domain_is_reserved_once_whatever_the_temporary_folder(claimed, monkeypatch, tmp_path):
    assert claimed(7)
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    assert claimed(7) is None and claimed(8)
    assert domains.running() == [7, 8]


def test_of_several_flights_one_must_be_chosen(claimed, monkeypatch):
    claimed(2)
    claimed(11)
    with pytest.raises(InputError, match='domains 2, 11: choose one with ROS_DOMAIN_ID'):
        domains.chosen()
    monkeypatch.setenv('ROS_DOMAIN_ID', '11')
    assert domains.chosen() == 11


@pytest.mark.parametrize('asked', ['x', '-1', '233', '٣'])
def test_what_is_no_domain_is_refused(claimed, monkeypatch, asked):
    monkeypatch.setenv('ROS_DOMAIN_ID', asked)
    with pytest.raises(InputError, match='is not a whole number from 0 to 232'):
        domains.chosen()
