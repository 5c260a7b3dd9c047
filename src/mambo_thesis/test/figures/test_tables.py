"""Tables of the thesis: operations counted, sensors there, moments of inertia in percent."""

from mambo_model.motion import quaternion
from mambo_model.vehicle.parameters import preset
from mambo_thesis.figures import tables, truths
from mambo_thesis.figures.tables import Counted, counted, plain
from mambo_thesis.figures.truths import MUTATIONS
import numpy as np
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


@pytest.mark.parametrize(('name', 'function', 'sizes'), [
    ('product of two quaternions', quaternion.multiply, (4, 4)),
    ('vector turned by a quaternion', quaternion.rotate, (4, 3))])
def test_the_operations_of_the_table_are_those_of_our_functions(name, function, sizes):
    arguments = [tuple(Counted() for _ in range(n)) for n in sizes]
    assert counted(lambda: plain(function)(*arguments)) == tables.OPERATIONS[name]


def test_matrices_need_27_multiplications_and_vectors_9():
    """n^3 and n^2 multiplications, n^2 (n - 1) and n (n - 1) additions, of 3 by 3 numbers."""
    A = np.array([[Counted() for _ in range(3)] for _ in range(3)], object)
    assert counted(lambda: A @ A) == tables.OPERATIONS['product of two matrices'] == (27, 18)
    assert counted(lambda: A @ A[0]) == tables.OPERATIONS['vector turned by a matrix'] == (9, 6)


def test_the_moments_of_inertia_rise_by_the_percentages_of_the_text():
    """From the two vehicle files alone, as printed: 19, 8 and 50 %."""
    rise = 100.0 * (np.array(preset('identified').inertia) / preset('toolbox').inertia - 1.0)
    np.testing.assert_allclose(rise, tables.INCREASES, atol=1.0)
    assert [m.low for m in tables.table_4_2().measured] == pytest.approx(rise)


def test_a_sensor_too_many_is_noticed(monkeypatch):
    monkeypatch.setitem(tables.SENSORS, 'sonar', False)
    found, = tables.table_4_1().measured
    assert found.low == 1 and not found.holds
