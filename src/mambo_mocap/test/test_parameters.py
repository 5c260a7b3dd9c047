"""Parameters of the nodes: what is refused, and with which words."""

from mambo_mocap.parameters import (
    bodies, NatNetClientNodeParams, NatNetServerNodeParams, places)
from mambo_model.schema import ParameterError
import pytest


def test_bodies_are_names_or_numbers_and_topics():
    assert bodies('mambo=optitrack/pose, 7=/cf1/pose,a=b=c/d') == {
        'mambo': 'optitrack/pose', '7': '/cf1/pose', 'a=b': 'c/d'}
    assert len(bodies(','.join(f'drone{k}=/d{k}/pose' for k in range(256)))) == 256


@pytest.mark.parametrize(('text', 'words'), [
    ('', 'names 0 bodies'), ('mambo', 'must be NAME=TOPIC'), ('=pose', 'must be NAME=TOPIC'),
    ('a=b,a=c', 'repeats'), ('a=b,c=b', 'repeats'),
    (','.join(f'drone{k}=/d{k}' for k in range(257)), 'names 257 bodies')])
def test_other_texts_are_refused(text, words):
    with pytest.raises(ParameterError, match=words):
        NatNetClientNodeParams(bodies=text)


@pytest.mark.parametrize(('given', 'words'), [
    ({'address': 'localhost'}, "address = 'localhost' must be an IPv4 address such as"),
    ({'group': '10.0.0.1'}, 'group = .* must be a multicast address'),
    ({'body': ''}, 'body: a name has 1 to 255 bytes'), ({'body': 'x' * 256}, '1 to 255 bytes'),
    ({'data_port': 1510}, 'data_port is command_port'), ({'rate': 2000.0}, 'outside')])
def test_a_server_refuses_what_it_cannot_serve(given, words):
    with pytest.raises(ParameterError, match=words):
        NatNetServerNodeParams(**given)


@pytest.mark.parametrize('kind', [NatNetServerNodeParams, NatNetClientNodeParams])
def test_each_body_has_a_place(kind):
    two = 'a=/a/pose, b=/b/pose'
    assert places(kind(bodies=two, places='1 2 3; 4 5 6').places, 2) == [
        (1.0, -2.0, -3.0), (4.0, -5.0, -6.0)]
    assert places('', 2) == [(0.0, 0.0, 0.0)] * 2
    for text in ('1 2 3', '1 2; 3 4', '1 2 x; 3 4 5', '1 2 inf; 3 4 5'):
        with pytest.raises(ParameterError, match='must be 2 times x y z in m'):
            kind(bodies=two, places=text)


def test_a_server_has_one_body_or_those_it_is_given():
    assert NatNetServerNodeParams(body='drone').topics == {'drone': 'ground_truth/odom'}
    assert NatNetServerNodeParams(bodies='a=/a/truth, b=/b/truth').topics == {
        'a': '/a/truth', 'b': '/b/truth'}
    with pytest.raises(ParameterError, match='leaves no seeds for 2 bodies'):
        NatNetServerNodeParams(bodies='a=/a/truth, b=/b/truth', seed=2**31 - 1)


def test_versions_are_numbers():
    assert NatNetServerNodeParams(version='4.1').protocol == (4, 1)
    assert NatNetServerNodeParams(rate=360.0).period == 2_777_778
    with pytest.raises(ParameterError, match='server = '):
        NatNetClientNodeParams(server='239.255.42.99')
