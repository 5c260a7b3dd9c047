"""A flight of a known force model as arrays, and as a bag of a table."""

from mambo_analysis.importers.any_table import import_table
from mambo_analysis.twin.force import ForceModel
from mambo_analysis.twin.recorded import GRAVITY, MIX, Recorded, STEP
from mambo_analysis.twin.torque import TorqueModel
import numpy as np
import pandas
from scipy.spatial.transform import Rotation

TRUE = ForceModel((0.4, 0.35, 0.25), (0.05, -0.03), 2.45, 1.8, 0.05, 40000.0, 3.6)
NOISE = 0.05  # m/s^2, of the accelerometer


def flight(seed=0, seconds=15.0, model=TRUE, noise=NOISE, radius=1.0):
    """
    Return a flight around a circle, of a radius in m, that rises, falls and trembles.

    Its commands obey a model.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / STEP)) * STEP
    slow, fast = 1.3 * t, 9.0 * t
    c, d, up = radius * np.cos(t), radius * np.sin(t), 1.0 + 0.4 * np.sin(slow)
    p = np.column_stack([c, d, up + 0.01 * np.sin(fast)])
    v = np.column_stack([-d, c, 0.52 * np.cos(slow) + 0.09 * np.cos(fast)])
    a = np.column_stack([-c, -d, -0.676 * np.sin(slow) - 0.81 * np.sin(fast)])
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
    gyro = np.gradient(np.cumsum(np.concatenate(
        [np.zeros((1, 3)), (turn[:-1].inv() * turn[1:]).as_rotvec()]), axis=0), STEP, axis=0)
    return Recorded('flight', t, p, v, turn.as_quat(), force, gyro, command, voltage,
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
REFERENCE = '  onboard/reference: {position: [x, y, z]}\n'
STRAIGHT = np.zeros(3)
MOUNTING = np.array([0.01, -0.02, 0.0])


def bag(folder, change=lambda data: data, text=MAP, seconds=12.0, seed=0, noise=0.0, radius=1.0):
    """
    Return the path of a bag with markers mounted askew.

    Two seconds at rest, two in which somebody lifts it by 1 m, and a flight.
    """
    one = flight(seed, seconds, noise=noise, radius=radius)
    return table_of(one, folder, change, text, MOUNTING)


def table_of(one, folder, change=lambda data: data, text=MAP, mounting=STRAIGHT,
             reference=False):
    """Return the path of a bag of a flight, after two seconds of rest and two of lifting."""
    q = (one.turn * Rotation.from_rotvec(mounting).inv()).as_quat()
    columns = dict(zip(('x', 'y', 'z'), one.position.T)) | dict(zip(
        ('qx', 'qy', 'qz', 'qw'), q.T))
    columns |= dict(zip(('p', 'q', 'r'), one.gyro.T)) | dict(zip(('ax', 'ay', 'az'), one.force.T))
    columns |= {f'm{j + 1}': one.command[:, j] for j in range(4)}
    data = pandas.DataFrame(columns)
    data['v'] = one.voltage
    still = pandas.concat([data.iloc[:1]] * 400, ignore_index=True)
    still[['m1', 'm2', 'm3', 'm4', 'p', 'q', 'r']] = 0.0
    lift = np.clip(np.arange(400) / 200.0 - 1.0, 0.0, 1.0)
    still['z'] += 0.5 * (1.0 - np.cos(np.pi * lift)) - 1.0
    data = pandas.concat([still, data], ignore_index=True)
    data['t'] = np.arange(len(data)) * STEP
    source, mapping = folder / 'flight.csv', folder / 'map.yaml'
    change(data).to_csv(source, index=False)
    mapping.write_text(text + REFERENCE if reference else text)
    import_table(source, folder / 'bag', mapping)
    return folder / 'bag'


SPIN = TorqueModel((30.0, 28.0, 4.0), (9.0, -8.0), (1.0, 1.5, 2.0))


def steered(seed=0, seconds=12.0, torque=SPIN, model=TRUE, shake=0.0):
    """
    Return a flight whose motors turn it: the models hold in every step, to the bit of a float.

    A controller follows wanted tilts and holds the place loosely. ``shake`` is the standard
    deviation of a torque that no model knows, rad/s^2.
    """
    rng = np.random.default_rng(seed)
    n = round(seconds / STEP)
    left, phase = np.exp(-STEP / model.lag), rng.uniform(0.0, 6.0, 3)
    p, v, rate, turn = np.array([0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3), Rotation.identity()
    lagged, rows = None, []
    for k in range(n):
        t, w = k * STEP, turn.inv().apply(v)
        yaw, pitch, roll = turn.as_euler('ZYX')
        wanted = np.array([0.15 * np.sin(1.7 * t + phase[0]) + 0.05 * (p[1] + v[1]),
                           0.15 * np.sin(1.3 * t + phase[1]) - 0.05 * (p[0] + v[0]),
                           0.3 * np.sin(0.9 * t + phase[2])])
        spin = 15.0 * (6.0 * (wanted - [roll, pitch, yaw]) - rate)
        lift = GRAVITY + 2.0 * (1.0 - p[2]) - 2.0 * v[2] + 0.5 * np.sin(2.1 * t)
        each = 0.25 * (lift + MIX.T @ (spin / np.array(torque.gain)))
        each = np.maximum(each, 0.1)
        lagged = each if lagged is None else left * lagged + (1.0 - left) * each
        force = model.force(np.array([lagged.sum()]), w[None])[0]
        rows.append((p, v, turn.as_quat(), force, rate, each))
        a = turn.apply(force) - [0.0, 0.0, GRAVITY]
        spun = torque.acceleration((MIX @ lagged)[None], w[None], rate[None])[0]
        spun = spun + rng.normal(0.0, shake, 3)
        p, v = p + STEP * v + 0.5 * STEP * STEP * a, v + STEP * a
        turn = turn * Rotation.from_rotvec(STEP * (rate + 0.5 * STEP * spun))
        rate = rate + STEP * spun
    position, velocity, attitude, force, gyro, each = (np.array(x) for x in zip(*rows))
    voltage = model.voltage + 0.1 - 0.2 * np.arange(n) / n
    command = model.command * model.voltage / voltage[:, None] * (
        each / model.thrust) ** (1.0 / model.exponent)
    return Recorded(f'steered {seed}', np.arange(n) * STEP, position, velocity, attitude, force,
                    gyro, command, voltage, slice(0, n), slice(0, 0), np.zeros(3))


def answered(seed=0, seconds=20.0):
    """
    Return a flight that a controller and gusts turn, with a gyro that has noise.

    A wanted acceleration that changes in every step is followed through a lag of 50 ms.
    """
    rng = np.random.default_rng(seed)
    rate, lagged, rows = np.zeros(3), np.zeros(3), []
    for _ in range(round(seconds / STEP)):
        gyro = rate + rng.normal(0.0, 0.01, 3)
        wanted = rng.normal(0.0, 5.0, 3) - 8.0 * gyro
        rows.append((gyro, wanted))
        lagged = lagged + 0.2 * (wanted - lagged)
        rate = rate + STEP * (lagged + rng.normal(0.0, 5.0, 3))
    gyro, wanted = (np.array(x) for x in zip(*rows))
    return flight(seconds=seconds)._replace(gyro=gyro, command=4e4 + 100.0 * wanted @ MIX)
