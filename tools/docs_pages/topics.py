"""Tables of topics, services and messages, from the tables of ``mambo_ros`` and their files."""

from __future__ import annotations

import re
from typing import NamedTuple

from mambo_ros import topics
from mambo_ros.commands import table as services

from .source import SRC, table


class Use(NamedTuple):
    """What the table of topics does not say: content with unit and frame, and who uses it."""

    content: str
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]


_SIM, _ESTIMATOR, _CONTROLLER = ('sim_node',), ('estimator_node',), ('controller_node',)
_DESCRIPTION = ('description_node',)
USES = {
    '/clock': Use('flight time [s]', _SIM, ('reference_node',)),
    'imu/data_raw': Use('specific force [m/s^2], body rate [rad/s]; body FLU, `base_link`',
                        _SIM, _ESTIMATOR),
    'sonar/range': Use('slant range downwards [m]; `base_link`', _SIM, _ESTIMATOR),
    'optical_flow': Use('line-of-sight rate of the ground [rad/s]; body FLU, `base_link`',
                        _SIM, _ESTIMATOR),
    'barometer/pressure': Use('static pressure [Pa]; `base_link`', _SIM, _ESTIMATOR),
    'sensor_tick': Use('how many samples of each sensor exist', _SIM, _ESTIMATOR),
    'ground_truth/odom': Use(
        'true pose [m] in `map`, velocity [m/s] and body rate [rad/s] in `base_link`; the '
        'estimator takes it with `estimator: ground_truth` alone', _SIM,
        ('optitrack_node', 'natnet_server_node')),
    'optitrack/pose': Use(
        'pose [m] in `map`; nothing while the body is lost; the estimator takes it with '
        '`joint.pose.enabled`', ('optitrack_node', 'natnet_client_node'), _ESTIMATOR),
    'optitrack/tick': Use('how many poses exist; where the estimator uses them',
                          ('optitrack_node',), _ESTIMATOR),
    'estimate/odom': Use(
        'pose [m] in `odom`, velocity [m/s] and body rate [rad/s] in `base_link`, covariances',
        _ESTIMATOR, _CONTROLLER),
    'estimate/map': Use(
        'the same in `map`; where the estimator uses the motion capture', _ESTIMATOR, _CONTROLLER),
    'estimator/state': Use('biases, innovations, health of each sensor', _ESTIMATOR, ()),
    'reference': Use('position to snap, attitude, rates, thrust, torque; `odom` and body FLU',
                     ('reference_node',), _CONTROLLER),
    'command': Use('accepted commands of a commanded flight', ('reference_node',), ()),
    'joy': Use('sticks and buttons, in a commanded flight', (), ('reference_node',)),
    'setpoint': Use('reference from outside, in a commanded flight; `odom` and body FLU', (),
                    ('reference_node',)),
    'controller/state': Use('errors, virtual input, desired attitude, thrust and torque',
                            _CONTROLLER, ()),
    'motor_pwm': Use('command of the four motors [PWM], shutdown and its reason',
                     _CONTROLLER, _SIM),
    '/tf': Use('`map` to `odom` to `base_link` [m]', _ESTIMATOR, ()),
    '/diagnostics': Use('status of the node',
                        ('sim_node', 'optitrack_node', 'estimator_node', 'controller_node',
                        'natnet_server_node', 'natnet_client_node'), ()),
    'graph/links': Use('which topics a node publishes and subscribes to, and what is matched',
                       ('every node',), ('every node',)),
    'robot_description': Use('URDF of the drone', _DESCRIPTION, ()),
    '/tf_static': Use('fixed frames of the vehicle: `imu_link`, `sonar_link` (the beam is +x), '
                      '`camera_link`, rotors, markers', _DESCRIPTION, ()),
    'path/true': Use('true way in `map`, on request', _DESCRIPTION, ()),
    'path/estimated': Use('estimated way in `odom`, on request', _DESCRIPTION, ()),
    'path/measured': Use('way of the motion capture in `map`, on request', _DESCRIPTION, ()),
    'path/reference': Use('way of the reference in `odom`, on request', _DESCRIPTION, ()),
    'markers': Use('name, motor commands and reference, on request', _DESCRIPTION, ()),
    'sonar/beam': Use('slant range [m] in `sonar_link`, on request', _DESCRIPTION, ())}


def all_topics() -> list[topics.Topic]:
    """Return every topic of the graph."""
    return [*topics.RECORDABLE, topics.JOY, topics.SETPOINT, topics.LINKS, *topics.DESCRIBED]


def _rate(topic: topics.Topic) -> str:
    return f'{topic.rate:g} Hz' if topic.rate else 'on change'


def topic_table() -> str:
    """Return the table of all topics."""
    rows = []
    for topic in all_topics():
        use = USES[topic.name]
        qos = 'reliable, ' + ('transient local' if topic.transient_local else 'volatile')
        rows.append((
            f'`{topic.name}`<br>`{topic.type_name.replace("/msg/", "/")}`', _rate(topic), qos,
            ', '.join(use.publishers), ', '.join(use.subscribers), use.content))
    return table(('topic and type', 'rate', 'quality of service', 'from', 'to',
                  'content, unit, frame'), rows)


_CONSTANT = re.compile(r'(\w+) (\w+) *= *([^#\s]+)\s*(?:# ?(.*))?')
_FIELD = re.compile(r'([\w/]+(?:\[\w*\])?) (\w+)\s*(?:# ?(.*))?')


def _message(text: str) -> list[str]:
    """Return the Markdown of one message file: its comment, constants and fields."""
    prose: list[str] = []
    constants, fields = [], []
    for line in text.splitlines():
        if line.startswith('#'):
            (prose if not fields else []).append(line.lstrip('# '))
        elif not line.strip():
            prose.append('')
        elif found := _CONSTANT.fullmatch(line):
            constants.append((f'`{found[2]}`', found[3], found[4] or ''))
        elif found := _FIELD.fullmatch(line):
            fields.append((f'`{found[2]}`', f'`{found[1]}`', found[3] or ''))
        else:
            raise ValueError(f'no line of a message: {line}')
    out = ['\n'.join(prose).strip(), '']
    if constants:
        out += [table(('constant', 'value', 'meaning'), constants), '']
    return [*out, table(('field', 'type', 'unit and meaning'), fields), '']


def messages() -> str:
    """Return a section for each message of ``mambo_interfaces``."""
    out = []
    for file in sorted((SRC / 'mambo_interfaces/msg').glob('*.msg')):
        out += [f'### {file.stem}', '', *_message(file.read_text(encoding='utf-8'))]
    return '\n'.join(out)


def all_services() -> dict[services.Service, str]:
    """Return every command service with the node that answers it."""
    return {**dict.fromkeys(services.REFERENCE, 'reference_node'),
            services.PAUSE: 'sim_node', services.STEP: 'sim_node'}


def service_table() -> str:
    """Return the table of all command services, and the fields of our own types."""
    out = [table(('service and type', 'of'), [
        (f'`{one.name}`<br>`{one.type_name.replace("/srv/", "/")}`', node)
        for one, node in all_services().items()]), '']
    for file in sorted((SRC / 'mambo_interfaces/srv').glob('*.srv')):
        request = file.read_text(encoding='utf-8').partition('---')[0]
        out += [f'### {file.stem}', '', *_message(request)]
    return '\n'.join(out)
