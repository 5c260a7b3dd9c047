"""One flight per ROS domain, whoever flies it."""

import gc
import os
import subprocess
import sys

from mambo_bringup import domain
from mambo_bringup.domain import Domain
from mambo_bringup.processes import FlightError
from mambo_ros.graph import domains
import pytest

VARIABLES = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Keep the claims of these tests apart from flights under way."""
    monkeypatch.setattr(domains, '_NAME', f'\0{tmp_path}_')
    for name in VARIABLES:
        monkeypatch.setenv(name, '')  # so that it is put back whatever a test does


def test_the_domain_of_the_user_is_taken_as_it_is(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    with Domain() as claimed:
        assert claimed.number == 42
    assert [os.environ[name] for name in VARIABLES] == ['42', 'SUBNET']


def test_a_second_flight_in_the_domain_of_the_user_is_refused_with_one_line(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    with Domain():
        with pytest.raises(FlightError) as refusal:
            Domain()
    assert str(refusal.value) == (
        'another flight is running in ROS domain 42: wait, or set ROS_DOMAIN_ID')


def test_without_a_choice_the_first_free_domain_is_taken(monkeypatch):
    first = Domain()
    monkeypatch.setenv('ROS_DOMAIN_ID', '')  # as another terminal has it
    second = Domain()
    assert (first.number, second.number) == (0, 1)
    assert os.environ['ROS_DOMAIN_ID'] == '1'
    first.release()
    monkeypatch.setenv('ROS_DOMAIN_ID', '')
    assert Domain().number == 0
    assert second.number == 1


def test_discovery_stays_on_this_machine_unless_the_user_says_otherwise():
    with Domain():
        assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'


def test_a_domain_is_free_again_and_the_environment_as_it_was_at_the_end(monkeypatch):
    for name in VARIABLES:
        monkeypatch.delenv(name)
    for _ in range(3):
        with Domain() as claimed:
            assert claimed.number == 0
            assert os.environ['ROS_DOMAIN_ID'] == '0'
        assert not any(name in os.environ for name in VARIABLES)


def test_an_object_that_is_gone_holds_nothing(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    claimed = Domain()
    del claimed
    gc.collect()
    assert Domain().number == 7


def test_the_claim_of_a_killed_flight_is_gone_with_it(monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    holder = subprocess.Popen(
        [sys.executable, '-c', 'import time\nfrom mambo_bringup.domain import Domain\n'
         f'from mambo_ros.graph import domains\ndomains._NAME = {domains._NAME!r}\n'
         'claimed = Domain()\nprint(claimed.number, flush=True)\ntime.sleep(60)'],
        env={**os.environ, 'TMPDIR': str(tmp_path)}, stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline() == '7\n'
    with pytest.raises(FlightError, match='ROS domain 7'):
        Domain()
    holder.kill()
    holder.communicate()
    assert Domain().number == 7


def test_children_do_not_inherit_the_claim(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    with Domain():
        child = subprocess.Popen(['sleep', '60'], close_fds=False)
    try:
        assert Domain().number == 7
    finally:
        child.kill()
        child.wait()


@pytest.mark.parametrize('nonsense', ['one', '-1', '1.5', '0x1', '233', '99999999', ' 1', '²'])
def test_a_domain_that_cannot_be_is_refused_with_one_line(monkeypatch, nonsense):
    monkeypatch.setenv('ROS_DOMAIN_ID', nonsense)
    with pytest.raises(FlightError) as refusal:
        Domain()
    assert refusal.value.exit_code == 2
    assert str(refusal.value) == (
        f'ROS_DOMAIN_ID = {nonsense!r} is not a whole number from 0 to 232')


def test_an_error_names_that_all_domains_are_taken(monkeypatch):
    monkeypatch.setattr(domain, '_FREE', range(2))
    claims = []
    for _ in range(2):
        claims.append(Domain())
        monkeypatch.setenv('ROS_DOMAIN_ID', '')
    with pytest.raises(FlightError) as refusal:
        Domain()
    assert str(refusal.value) == 'no free ROS domain: other flights use all of them'


@pytest.mark.long
@pytest.mark.parametrize('module, name', [
    ('mambo_bringup.run', 'run'), ('mambo_sim.sim_node', 'sim_node'),
    ('mambo_bringup.composed_node', 'recorder_node')])
def test_without_a_loopback_interface_all_is_refused_at_once_with_one_line(
        tmp_path, module, name):
    alone = ['unshare', '--user', '--map-root-user', '--net']
    if subprocess.run([*alone, 'true'], capture_output=True).returncode:
        pytest.skip('this user may not make a network namespace')
    done = subprocess.run(
        [*alone, sys.executable, '-c', f'from {module} import main; raise SystemExit(main())',
         *(['--output', str(tmp_path / 'bag')] if name == 'run' else [])],
        text=True, capture_output=True, timeout=60.0)
    assert (done.returncode, done.stdout) == (1, '')
    (line,) = done.stderr.splitlines()
    assert line.startswith(
        f'{name}: nodes cannot find each other, the loopback interface does not work')
    assert line.endswith('ip link set lo up')
