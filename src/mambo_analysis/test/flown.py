"""A flight of a known force model as arrays, and as a bag of a table."""

from mambo_analysis.importers.any_table import import_table
from mambo_analysis.twin.force import ForceModel
from mambo_analysis.twin.recorded import GRAVITY, Recorded, STEP
import numpy as np
import pandas
from scipy.spatial.transform import Rotation

TRUE = ForceModel((0.4, 0.35, 0.25), (0.05, -0.03), 2.45, 1.8, 0.05, 40000.0, 3.6)
NOISE = 0.05  # m/s^2, of the accelerometer


def flight(seed=0, seconds=15.0, model=TRUE, noise=NOISE):
    """
    Return a flight around a circle that rises, falls and trembles.

    Its commands obey a model.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / STEP)) * STEP
    slow, fast = 1.3 * t, 9.0 * t
    p = np.column_stack([np.cos(t), np.sin(t), 1.0 + 0.4 * np.sin(slow) + 0.01 * np.sin(fast)])
    v = np.column_stack([-np.sin(t), np.cos(t), 0.52 * np.cos(slow) + 0.09 * np.cos(fast)])
    a = np.column_stack([-np.cos(t), -np.sin(t), -0.676 * np.sin(slow) - 0.81 * np.sin(fast)])
    turn = Rotation.identity(len(t))
    for _ in range(20):  # attitude and thrust that give this acceleration, at yaw 0
        w = turn.inv().apply(v)
        side = np.column_stack([model.tilt[0] - model.drag[0] * w[:, 0],
                                model.tilt[1] - model.drag[1] * w[:, 1], -model.drag[2] * w[:, 2]])
        lift = a + [0.0, 0.0, GRAVITY] - turn.apply(side)
        size = np.linalg.norm(lift, axis=1)
        z = lift / size[:, None]
        x = np.cross(np.tile([0.0, 1.0, 0.0], (len(t), 1)), z)
        x /= np.linalg.norm(x, axis=1)[:, None]
        turn = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2))
    # the command whose lagged map is this thrust, shared by four equal motors
    left = np.exp(-STEP / model.lag)
    wanted = np.append((size[1:] - left * size[:-1]) / (1.0 - left), size[-1])
    wanted = np.concatenate([size[:1], wanted[:-1]])
    voltage = model.voltage + 0.1 - 0.2 * t / seconds
    share = (wanted / 4.0 / model.thrust) ** (1.0 / model.exponent)
    command = np.tile((model.command * share * model.voltage / voltage)[:, None], (1, 4))
    force = side + np.column_stack([0.0 * size, 0.0 * size, size])
    force = force + rng.normal(0.0, noise, force.shape)
    rows = slice(0, len(t))
    return Recorded('flight', t, p, v, turn.as_quat(), force, np.zeros_like(p), command, voltage,
                    rows, slice(0, 0), np.zeros(3))


MAP = """\
time: {column: t}
topics:
  optitrack/pose:
    position: [x, y, z]
    quaternion: {columns: [qx, qy, qz, qw], order: xyzw}
  imu/data_raw: {angular_velocity: [p, q, r], acceleration: [ax, ay, az]}
  motor_pwm: {pwm: [m1, m2, m3, m4]}
  battery: {voltage: [v]}
"""
MOUNTING = np.array([0.01, -0.02, 0.0])


def bag(folder, change=lambda data: data, text=MAP, seconds=12.0, seed=0, noise=0.0):
    """
    Return the path of a bag with markers mounted askew.

    Two seconds at rest, two in which somebody lifts it by 1 m, and a flight.
    """
    one = flight(seed, seconds, noise=noise)
    q = (one.turn * Rotation.from_rotvec(MOUNTING).inv()).as_quat()
    columns = dict(zip(('x', 'y', 'z'), one.position.T)) | dict(zip(
        ('qx', 'qy', 'qz', 'qw'), q.T))
    columns |= dict(zip(('p', 'q', 'r'), one.gyro.T)) | dict(zip(('ax', 'ay', 'az'), one.force.T))
    columns |= {f'm{j + 1}': one.command[:, j] for j in range(4)}
    data = pandas.DataFrame(columns)
    data['v'] = one.voltage
    still = pandas.concat([data.iloc[:1]] * 400, ignore_index=True)
    still[['m1', 'm2', 'm3', 'm4']] = 0.0
    lift = np.clip(np.arange(400) / 200.0 - 1.0, 0.0, 1.0)
    still['z'] += 0.5 * (1.0 - np.cos(np.pi * lift)) - 1.0
    data = pandas.concat([still, data], ignore_index=True)
    data['t'] = np.arange(len(data)) * STEP
    source, mapping = folder / 'flight.csv', folder / 'map.yaml'
    change(data).to_csv(source, index=False)
    mapping.write_text(text)
    import_table(source, folder / 'bag', mapping)
    return folder / 'bag'
