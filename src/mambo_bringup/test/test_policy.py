"""The access policy allows every node what it does, and nothing else."""

import time
from xml.etree import ElementTree

from free_port import free_port
from mambo_bringup import policy
from mambo_flight.world.formation import namespaces
from mambo_ros import topics
import pytest
import rclpy

AIDED = ['-p', 'estimator:=joint', '-p', 'joint.pose.enabled:=true']
OPTIONS = {  # of a node with which it opens each of its topics
    'estimator_node': [AIDED, ['-p', 'estimator:=ground_truth']],
    'controller_node': [[], ['-p', 'estimate:=map']],
    'reference_node': [['-p', 'commands.enabled:=true']],
    'optitrack_node': [['-p', 'watermark:=true']],
    'view_node': [['-p', 'port:=PORT']],
    'description_node': [['-p', 'paths:=true', '-p', 'markers:=true']],
    'recorder_node': [['-p', 'bag:=BAG', '-p', 'topics:=' + ','.join(
        one.name for one in (*topics.RECORDED, *topics.AIDED, *topics.COMMANDED))]]}


def listed(node, which, made):
    """Return what the middleware lists of a node, once all that the node made is in it."""
    until = time.monotonic() + 20.0
    while True:  # discovery takes its time
        found = {one for one, _ in which(*node)}
        if made <= found:
            return found
        assert time.monotonic() < until, made - found
        time.sleep(0.01)


def opened(package, name, words, bag):
    """Return what a node publishes, subscribes and answers, by the middleware."""
    words = [word.replace('BAG', str(bag)).replace('PORT', str(free_port())) for word in words]
    rclpy.init(args=['--ros-args', *words])
    try:
        node = policy.node_class(package, name)()
        me = (node.get_name(), node.get_namespace())
        made = ({one.topic_name for one in node.publishers},
                {one.topic_name for one in node.subscriptions},
                {node.resolve_service_name(one.srv_name) for one in node.services})
        published, subscribed, answered = (listed(me, which, names) for which, names in zip((
            node.get_publisher_names_and_types_by_node,
            node.get_subscriber_names_and_types_by_node,
            node.get_service_names_and_types_by_node), made))
        out = published, subscribed.union(one.name for one in node.inputs), answered
        assert not node.get_client_names_and_types_by_node(*me)
        if name == 'view_node':
            node.page.close()
        node.destroy_node()
        return out
    finally:
        rclpy.try_shutdown()


@pytest.mark.long
@pytest.mark.parametrize(('package', 'name'), policy.NODES[:-1], ids=lambda one: one)
def test_each_node_opens_what_its_policy_allows_and_no_less(package, name, tmp_path):
    found = [set(), set(), set()]
    for number, words in enumerate(OPTIONS.get(name, [[]])):
        for all_found, one in zip(found, opened(package, name, words, tmp_path / f'{number}')):
            all_found |= one
    granted = policy.allowed(package, name, '/mambo')
    while_waiting = {'/mambo/graph/links'} if name == 'sim_node' else set()
    assert found[0] == set(granted['publish'])
    assert found[1] | while_waiting == set(granted['subscribe'])
    assert found[2] == set(granted['reply'])


def test_the_file_has_the_form_of_sros2_and_an_enclave_for_each_node():
    root = ElementTree.fromstring(policy.policy(namespaces(2)).split('?>')[1])
    assert (root.tag, root.attrib) == ('policy', {'version': '0.2.0'})
    enclaves = root.findall('enclaves/enclave')
    assert [one.get('path') for one in enclaves] == [
        *(f'/mambo{number}/{node[1]}' for number in (1, 2) for node in policy.NODES
          if node not in policy.WATCHERS), '/mambo/view_node', '/mambo/description_node']
    for one in enclaves:
        profile, = one.findall('profiles/profile')
        assert one.get('path') == f'{profile.get("ns")}/{profile.get("node")}'
        assert [(part.tag, part.attrib) for part in profile] == [
            ('topics', {'publish': 'ALLOW'}), ('topics', {'subscribe': 'ALLOW'}),
            ('services', {'reply': 'ALLOW'}),
            *[('services', {'request': 'ALLOW'})] * (profile.get('node') == 'view_node')]
        names = [line.text for part in profile for line in part]
        if one.get('path').startswith('/mambo/'):
            continue
        assert all(name.startswith(('/mambo1/', '/mambo2/', '/rosout', '/parameter_events'))
                   for name in names), names  # not the clock of another drone


@pytest.mark.parametrize(('node', 'options'), [
    (policy.VIEW, [['-p', 'port:=PORT']]),
    (policy.DESCRIPTION, [
        ['-p', 'paths:=true', '-p', 'markers:=true'],
        ['-p', 'paths:=true', '-p', 'markers:=true', '-p', 'prefixed:=true']])],
    ids=['view', 'description'])
def test_what_watches_several_drones_may_do_so_and_no_more(node, options, tmp_path):
    found = [set(), set(), set()]
    for words in options:
        for all_found, one in zip(found, opened(
                *node, [*words, '-p', 'drones:=/mambo1,/mambo2'], tmp_path / 'bag')):
            all_found |= one
    granted = policy.watching(*node, ['/mambo1', '/mambo2'])
    assert found == [set(granted[kind]) for kind in ('publish', 'subscribe', 'reply')]


def test_one_drone_keeps_the_clock_and_frames_of_ros():
    granted = policy.allowed('mambo_sim', 'sim_node', '/mambo')
    assert '/clock' in granted['publish'] and '/mambo/motor_pwm' in granted['subscribe']
    assert '/mambo/motor_pwm' not in granted['publish']


def test_only_the_nodes_that_carry_commands_out_answer_them():
    answers = {
        name: {one.rpartition('/')[2] for one in policy.allowed(package, name, '/mambo')['reply']}
        - set(policy.SERVICES) for package, name in policy.NODES}
    assert answers.pop('reference_node') == {
        'takeoff', 'land', 'go_to', 'start_trajectory', 'stop'}
    assert answers.pop('sim_node') == {'pause', 'step'}
    assert not any(answers.values())


def test_only_the_page_sends_commands_and_only_to_its_drone():
    asked = {name: policy.allowed(package, name, '/mambo2').get('request', ())
             for package, name in policy.NODES}
    of_page = asked.pop('view_node')
    assert not any(asked.values())
    assert {'/mambo2/takeoff', '/mambo2/step',
            '/mambo2/controller_node/set_parameters_atomically'} < set(of_page)
    assert all(one.startswith('/mambo2/') for one in of_page)
    of_all = policy.watching(*policy.VIEW, ['/mambo1', '/mambo2'])['request']
    assert set(of_page) < set(of_all) and {'/mambo1/takeoff', '/mambo1/step'} < set(of_all)


def test_the_command_writes_a_file_once_and_refuses_what_cannot_be(tmp_path, capsys):
    target = tmp_path / 'new' / 'policy.xml'
    assert policy.main(['-o', str(target), '--drones', '3']) == 0
    assert target.read_text() == policy.policy(['/mambo1', '/mambo2', '/mambo3'])
    assert f'{3 * len(policy.NODES) - 4} enclaves' in capsys.readouterr().out
    for words, text in ((['-o', str(target)], 'exists'),
                        (['-o', str(tmp_path / 'b'), '--drones', '0'], '--drones: 0 must be')):
        with pytest.raises(SystemExit) as end:
            raise SystemExit(policy.main(words))
        assert end.value.code == 2
        said = capsys.readouterr().err
        assert said.count('\n') == 1 and text in said, said
