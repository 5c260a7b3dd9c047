"""Axes of a stream, held against rotation matrices."""

from mambo_mocap import axes
from mambo_model.motion.quaternion import rotate
import numpy as np
import pytest

# from the axes inside (NED or FRD) to those of the stream, row by row
TURN = {'z': np.diag([1.0, -1.0, -1.0]),
        'y': np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])}


def matrix(attitude):
    """Return the rotation matrix of a quaternion x y z w."""
    x, y, z, w = attitude
    return np.array([rotate((w, x, y, z), tuple(e)) for e in np.eye(3)]).T


@pytest.mark.parametrize('up', axes.UP)
def test_vectors_and_attitudes_turn_alike_and_come_back(up):
    rng = np.random.default_rng(1)
    for _ in range(20):
        rho = tuple(rng.normal(size=3).tolist())
        q = rng.normal(size=4)
        q = tuple((q / np.linalg.norm(q)).tolist())
        there, turned = axes.to_stream(rho, up), axes.attitude_to_stream(q, up)
        np.testing.assert_allclose(there, TURN[up] @ rho, atol=1e-15)
        inside = matrix((q[1], q[2], q[3], q[0]))
        np.testing.assert_allclose(
            matrix(turned), TURN[up] @ inside @ TURN[up].T, atol=1e-12)
        assert axes.from_stream(there, up) == rho
        assert axes.attitude_from_stream(turned, up) == q


def test_up_is_up():
    assert axes.to_stream((0.0, 0.0, -1.5), 'y')[1] == 1.5
    assert axes.to_stream((0.0, 0.0, -1.5), 'z')[2] == 1.5
