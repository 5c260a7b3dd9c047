"""Tables of the thesis: operations counted, sensors there, moments of inertia in percent."""

from mambo_model.motion import quaternion
from mambo_thesis.figures import tables, truths
from mambo_thesis.figures.tables import Counted, counted, plain
from mambo_thesis.figures.truths import MUTATIONS
import pytest


def test_operations_are_counted_one_by_one():
    a, b = Counted(), Counted()
    assert counted(lambda: a * b + a) == (1, 1)
    assert counted(lambda: 2.0 * a - b - 1.0) == (1, 2)
    assert counted(lambda: None) == (0, 0)


def test_a_compiled_function_is_the_same_in_plain_python():
    q, v = (0.5, 0.5, -0.5, 0.5), (1.0, 2.0, 3.0)
    assert plain(quaternion.rotate)(q, v) == pytest.approx(quaternion.rotate(q, v))


@pytest.mark.parametrize('table', [tables.table_2_1, tables.table_4_1, tables.table_4_2])
def test_tables_hold(table):
    assert all(m.holds for m in table().measured)


def test_a_wasteful_rotation_would_be_noticed(monkeypatch):
    monkeypatch.setattr(tables.quaternion, 'multiply', lambda p, q: (p[0] * q[0],))
    assert not all(m.holds for m in tables.table_2_1().measured)


def test_another_inertia_is_noticed():
    with truths.mutated(MUTATIONS['inertia x 2']):
        assert not any(m.holds for m in tables.table_4_2().measured)


def test_a_missing_sensor_is_noticed(monkeypatch):
    monkeypatch.setitem(tables.SENSORS, 'lidar', True)
    assert tables.table_4_1().measured[0].low == 1
