"""The smoother against the whole flight solved at once, and against the filter."""

from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
from mambo_flight import closed_loop
from mambo_flight.accuracy.filter_error import with_unknowns
from mambo_flight.accuracy.filter_run import WIDTH
from mambo_flight.offline_replay import steps_of
from mambo_flight.scenario import scenario
from mambo_flight.smooth import forward_pass, smoother
from mambo_flight.smooth.smoother import added, difference, smooth, transition
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from smoothed_flight import steps

G = 9.81


def any_row(seed):
    """Return numbers of a state in flight."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, WIDTH)
    x[6:10] = Rotation.from_rotvec(0.5 * rng.standard_normal(3)).as_quat()[[3, 0, 1, 2]]
    return x


@pytest.mark.parametrize('seed', range(3))
def test_a_difference_that_is_added_gives_the_state(seed):
    x, d = any_row(seed), 0.1 * np.random.default_rng(seed + 9).standard_normal(SIZE)
    np.testing.assert_allclose(difference(added(x, d), x), d, atol=1e-12)
    np.testing.assert_allclose(difference(x, x), 0.0, atol=1e-12)


def moved(x, gyro, accel, dt):
    """Return a state dt later by its definition alone, the attitude turned by half before."""
    R = Rotation.from_quat(x[[7, 8, 9, 6]])
    turn = (gyro - x[10:13]) * dt
    a = (R * Rotation.from_rotvec(0.5 * turn)).apply(accel - x[13:16]) + [0.0, 0.0, G]
    q = (R * Rotation.from_rotvec(turn)).as_quat()[[3, 0, 1, 2]]
    return np.concatenate([
        x[:3] + dt * x[3:6] + 0.5 * dt * dt * a, x[3:6] + dt * a, q, x[10:]])


@pytest.mark.parametrize('seed', range(3))
def test_transition_by_finite_differences(seed):
    x, rng, dt, size = any_row(seed), np.random.default_rng(seed), 0.005, 1e-6
    gyro, accel = rng.standard_normal(3), rng.standard_normal(3) - [0.0, 0.0, G]
    later, F = moved(x, gyro, accel, dt), np.empty((SIZE, SIZE))
    for i in range(SIZE):
        d = np.zeros(SIZE)
        d[i] = size
        F[:, i] = difference(moved(added(x, d), gyro, accel, dt), later) / size
    # left out: second order in the step of 5 ms
    np.testing.assert_allclose(transition(x, later, dt, G), F, atol=20.0 * dt * dt)


class Problem:
    """A linear flight of steps that the smoother can be given in place of the filter's."""

    def __init__(self, steps=60, seed=0):
        rng = np.random.default_rng(seed)
        self.dt, self.rng, self.steps = 0.05, rng, steps
        A = rng.standard_normal((SIZE, SIZE))
        self.P0 = 1e-6 * (A @ A.T + np.eye(SIZE))
        B = rng.standard_normal((SIZE, SIZE))
        self.Q = 1e-8 * (B @ B.T)
        self.H = rng.standard_normal((steps, 2, SIZE))
        self.R = 1e-6 * np.eye(2)
        self.x0 = any_row(seed)
        self.path = [self.x0]
        for _ in range(steps - 1):
            self.path.append(moved(self.path[-1], np.array([0.3, -0.2, 0.1]),
                                   np.array([0.1, 0.2, -9.6]), self.dt))
        self.F = [transition(a, b, self.dt, G) for a, b in zip(self.path, self.path[1:])]
        self.z = 1e-3 * rng.standard_normal((steps, 2))

    def forward(self):
        """Return a Kalman filter of errors about the path, as the forward pass stores it."""
        n = self.steps
        x, predicted = np.empty((n, 24)), np.empty((n, 24))
        P, before = np.empty((n, SIZE, SIZE)), np.empty((n, SIZE, SIZE))
        d, C = np.zeros(SIZE), self.P0
        for k in range(n):
            if k:
                d, C = self.F[k - 1] @ d, self.F[k - 1] @ C @ self.F[k - 1].T + self.Q
            predicted[k], before[k] = added(self.path[k], d), C
            H = self.H[k]
            K = np.linalg.solve(H @ C @ H.T + self.R, H @ C).T
            d, C = d + K @ (self.z[k] - H @ d), C - K @ H @ C
            x[k], P[k] = added(self.path[k], d), C
        return forward_pass.Forward(
            np.full(n, self.dt), x, P, predicted, before, np.ones(n, np.bool_))

    def at_once(self):
        """Return errors (n, SIZE) and covariances of the whole flight by least squares."""
        n = self.steps
        J, y = np.zeros((SIZE * n + 2 * n, SIZE * n)), np.zeros(SIZE * n + 2 * n)
        root = np.linalg.inv(np.linalg.cholesky(self.P0))
        walk = np.linalg.inv(np.linalg.cholesky(self.Q))
        J[:SIZE, :SIZE] = root
        for k in range(1, n):
            rows, here = slice(SIZE * k, SIZE * k + SIZE), SIZE * k
            J[rows, here:here + SIZE] = walk
            J[rows, here - SIZE:here] = -walk @ self.F[k - 1]
        for k in range(n):
            rows = slice(SIZE * n + 2 * k, SIZE * n + 2 * k + 2)
            J[rows, SIZE * k:SIZE * k + SIZE] = self.H[k] / 1e-3
            y[rows] = self.z[k] / 1e-3
        information = J.T @ J
        C = np.linalg.inv(information)
        d = (C @ (J.T @ y)).reshape(n, SIZE)
        return d, np.array([C[SIZE * k:SIZE * k + SIZE, SIZE * k:SIZE * k + SIZE]
                            for k in range(n)])


@pytest.mark.long
def test_backward_pass_is_the_whole_flight_solved_at_once(monkeypatch):
    problem = Problem()
    monkeypatch.setattr(smoother.forward_pass, 'run', lambda found, params: problem.forward())
    found = steps()  # not looked at: the forward pass is given
    s = smooth(found, JointParams())
    d, P = problem.at_once()
    ours = np.array([difference(a, b) for a, b in zip(s.x, problem.path, strict=True)])
    deviation = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    # errors of millimetres: what is not linear in them is a thousandth of their deviation
    assert np.abs(ours - d).max() < 0.02 * np.abs(d).max()
    assert (np.abs(ours - d) < 0.05 * deviation + 1e-9).all()
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(s.P, axis1=1, axis2=2)), deviation, rtol=0.01)


@pytest.fixture(scope='module')
def flight():
    """Return a flight of 20 s whose scale, slope and latency are wrong, and its recording."""
    made = with_unknowns(scenario(
        trajectory='circle', estimator='joint', duration=20.0, land=False), 5, True)
    return made, closed_loop.fly(made)


@pytest.fixture(scope='module')
def smoothed(flight):
    made, recording = flight
    return smooth(steps_of(recording), made.estimator_node.joint)


@pytest.mark.long
def test_the_velocity_is_nearer_to_the_truth_than_that_of_the_filter(flight, smoothed):
    truth, s = flight[1].truth, smoothed
    on = s.moving
    v = Rotation.from_quat(truth[:, [7, 8, 9, 6]]).apply(truth[:, 3:6])

    def off(rows, want, first):
        return np.sqrt(((rows[on, first:first + 3] - want[on]) ** 2).mean())
    # the position is the sum of the flow's noise, which nothing later tells: test_coverage has it
    assert off(s.x, truth[:, :3], 0) < 1.1 * off(s.filtered.x, truth[:, :3], 0)
    assert off(s.x, v, 3) < 0.8 * off(s.filtered.x, v, 3)


@pytest.mark.long
def test_it_ends_as_the_filter_does_and_is_never_less_sure(smoothed):
    s = smoothed
    np.testing.assert_array_equal(s.x[-1], s.filtered.x[-1])
    own, filters = (np.diagonal(P, axis1=1, axis2=2)[s.moving] for P in (s.P, s.filtered.P))
    # the errors of both are linear about states of their own: within 2 % of a variance
    assert (own <= filters * 1.02 + 1e-12).all()
    assert (own >= 0.0).all()
    np.testing.assert_array_equal(s.x[~s.moving], s.filtered.x[~s.moving])


@pytest.mark.long
def test_before_take_off_and_without_steps_in_flight_there_is_nothing_to_smooth():
    made = scenario(estimator='joint', duration=0.5, land=False)
    s = smooth(steps_of(closed_loop.fly(made)), made.estimator_node.joint)
    np.testing.assert_array_equal(s.x, s.filtered.x)


@pytest.mark.long
def test_two_flights_with_a_rest_between_are_smoothed_each(flight):
    """Both land, and the vehicle waits: the filter is at rest there."""
    commands = '\n'.join(f'- {{time: {t}, {what}}}' for t, what in (
        (1.0, 'takeoff: {height: 1.2}'), (6.0, 'go_to: {goal: [1.0, 0.5, 1.2]}'),
        (10.0, 'land: {}'), (20.0, 'takeoff: {height: 1.0}'),
        (25.0, 'go_to: {goal: [0.0, 0.5, 1.2]}'), (29.0, 'land: {}')))
    made = scenario(estimator='joint', duration=38.0, overrides={
        'reference_node.commands.enabled': True, 'reference_node.commands.script': commands})
    s = smooth(steps_of(closed_loop.fly(made)), made.estimator_node.joint)
    t = 1e-9 * s.t
    for begin, end in ((3.0, 9.0), (22.0, 28.0)):
        flown = (t > begin) & (t < end)
        assert s.moving[flown].all()
        assert (np.abs(s.x - s.filtered.x)[flown, :2].max(axis=1) > 1e-6).mean() > 0.9
    waits = (t > 16.0) & (t < 19.0)
    assert not s.moving[waits].any()
    np.testing.assert_array_equal(s.x[waits], s.filtered.x[waits])
