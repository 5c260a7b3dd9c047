"""The layouts of RViz, Foxglove and PlotJuggler name topics, fields and frames that exist."""

import importlib
import json
from pathlib import Path
import re
from xml.etree import ElementTree

from mambo_description.display import MAP, ODOM
from mambo_description.static_frames import BASE, static_frames
from mambo_description.urdf import marker_places
from mambo_model.palette import COLOURS
from mambo_model.vehicle.parameters import preset
from mambo_ros import topics
import pytest
import yaml

FOLDER = Path(__file__).parents[1]
TOPICS = {topics.full_name(one, topics.NAMESPACE): one.msg_type
          for one in (*topics.RECORDABLE, *topics.DESCRIBED)}
FRAMES = {MAP, ODOM, BASE, *(
    frame.name for frame in static_frames(preset('identified'), marker_places()))}
RVIZ = {'RobotModel': 'String', 'Path': 'Path', 'Odometry': 'Odometry', 'Pose': 'PoseStamped',
        'MarkerArray': 'MarkerArray', 'Range': 'Range'}
"""Types that the displays of RViz take."""


def rviz():
    return yaml.safe_load((FOLDER / 'rviz/mambo.rviz').read_text())['Visualization Manager']


def foxglove():
    return json.loads((FOLDER / 'layouts/foxglove.json').read_text())


def plotjuggler():
    return ElementTree.parse(FOLDER / 'layouts/plotjuggler.xml').getroot()


def is_field(msg_type, path):
    """Return whether a path such as pose.position.x or pwm[3] leads to a number of a message."""
    name, _, rest = path.partition('.')
    name, index = re.fullmatch(r'(\w+)(?:\[(\d+)\])?', name).groups()
    kind = msg_type.get_fields_and_field_types().get(name)
    if kind is None:
        return False
    base, count = re.fullmatch(r'([\w/]+)(?:\[(\d+)\])?', kind).groups()
    if (index is None) != (count is None) or count is not None and int(index) >= int(count):
        return False
    if not rest:
        return '/' not in base
    package, _, name = base.partition('/')
    return bool(name) and is_field(getattr(importlib.import_module(f'{package}.msg'), name), rest)


def split(path):
    """Return the topic of a path, and the path of the field behind it."""
    topic = max((name for name in TOPICS if re.match(re.escape(name) + r'[./]', path)), key=len,
                default='')
    return topic, path[len(topic) + 1:].replace('/', '.')


@pytest.mark.parametrize('path, there', [
    ('pose.pose.position.x', True), ('pose.pose.position', False), ('pose.pose.height', False),
    ('pose.covariance[35]', True), ('pose.covariance[36]', False), ('pose.covariance', False)])
def test_the_check_of_a_field_can_fail(path, there):
    assert is_field(topics.ESTIMATE.msg_type, path) is there


def test_rviz_displays_get_topics_of_their_type():
    shown = 0
    for display in rviz()['Displays']:
        package, _, kind = display['Class'].partition('/')
        assert package == 'rviz_default_plugins'
        source = display.get('Topic') or display.get('Description Topic')
        if source is None:
            assert kind in ('Grid', 'TF')
            continue
        assert TOPICS[source['Value']].__name__ == RVIZ[kind]
        late = source['Value'].endswith('robot_description')
        assert source['Durability Policy'] == ('Transient Local' if late else 'Volatile')
        shown += 1
    assert shown == 9
    assert rviz()['Global Options']['Fixed Frame'] in FRAMES


def test_foxglove_panels_name_topics_fields_and_frames():
    layout, paths = foxglove(), []
    panels = layout['configById']
    for name, panel in panels.items():
        paths += [path['value'] for path in panel.get('paths', ())]
        assert all(path['color'] in COLOURS.values() for path in panel.get('paths', ())), name
    for path in paths:
        topic, field = split(path)
        assert is_field(TOPICS[topic], field), path
    assert len(paths) == 19
    scene = panels['3D!mambo']
    assert set(scene['topics']) < set(TOPICS) and scene['followTf'] in FRAMES
    assert scene['layers']['grid']['frameId'] in FRAMES
    assert scene['layers']['drone']['topic'] in TOPICS
    assert panels['DiagnosticSummary!health']['topicToRender'] in TOPICS
    places = re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(layout['layout']))
    assert sorted(places) == sorted(panels)


def test_plotjuggler_curves_name_topics_and_fields():
    curves = list(plotjuggler().iter('curve'))
    for curve in curves:
        topic, field = split(curve.get('name'))
        assert is_field(TOPICS[topic], field), curve.get('name')
        assert curve.get('color') in COLOURS.values()
    assert len(curves) == 29
    for splitter in plotjuggler().iter('DockSplitter'):
        assert int(splitter.get('count')) == len(list(splitter)) == len(
            splitter.get('sizes').split(';'))


def test_every_file_is_named_in_the_instructions():
    page = (FOLDER.parents[1] / 'docs/how-to/viewers.md').read_text()
    for file in (*(FOLDER / 'layouts').iterdir(), *(FOLDER / 'rviz').iterdir()):
        assert file.name in page
