"""Sockets on loopback."""

import select
import time

from mambo_mocap import udp
from mambo_model.errors import JobError
import pytest

HERE = '127.0.0.1'


def wait(source):
    assert select.select([source], [], [], 2.0)[0]
    return list(udp.receive(source))


@pytest.mark.parametrize('group', ['', '239.255.42.98'])
def test_packets_arrive_with_the_time_of_the_kernel(group):
    with udp.open_socket(HERE, 0, group) as target, udp.open_socket(HERE, 0) as source:
        address = (group or HERE, target.getsockname()[1])
        for _ in range(100):  # the kernel begins to stamp a little after it was asked to
            assert udp.send(source, b'early', address)
            time.sleep(0.02)
            reading = time.time_ns()
            if wait(target)[0][2] < reading:
                break
        before = time.time_ns()
        assert udp.send(source, b'one', address) and udp.send(source, b'two', address)
        after = time.time_ns()
        time.sleep(0.05)  # the time of arrival is not that of reading
        found, sender = wait(target), source.getsockname()
    assert [data for data, _, _ in found] == [b'one', b'two']
    # a busy kernel hands packets over soon after sending, but long before they are read
    assert all(before <= arrived <= after + 25_000_000 for _, _, arrived in found)
    assert found[0][1] == sender


def test_a_port_in_use_is_one_clear_line():
    with udp.open_socket(HERE, 0) as first, pytest.raises(JobError, match='cannot be used: Addr'):
        udp.open_socket(HERE, first.getsockname()[1])
    with pytest.raises(JobError, match=r'192\.0\.2\.1:0 cannot be used'):
        udp.open_socket('192.0.2.1', 0)


def test_what_the_system_refuses_is_told():
    with udp.open_socket(HERE, 0) as source:
        assert not udp.send(source, bytes(70_000), (HERE, 9))
        assert udp.send(source, b'to nobody', (HERE, 9))
        assert list(udp.receive(source)) == []
