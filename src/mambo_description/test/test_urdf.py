"""The URDF has the vehicle's numbers and the frames of /tf_static."""

from pathlib import Path
from xml.etree import ElementTree

from mambo_description import meshes
from mambo_description.static_frames import static_frames
from mambo_description.urdf import main, marker_places, urdf
from mambo_model.vehicle.parameters import preset
import pytest

PACKAGE = Path(__file__).parents[1]
VEHICLE = preset('identified')


def test_the_file_that_is_shipped_is_the_one_that_is_made():
    made = urdf(VEHICLE, marker_places())
    assert (PACKAGE / 'urdf/mambo.urdf').read_text() == made, (
        'mambo urdf > src/mambo_description/urdf/mambo.urdf')


def test_mass_and_inertia_are_those_of_the_vehicle():
    vehicle = preset('crazyflie')
    root = ElementTree.fromstring(urdf(vehicle))
    assert float(root.find('.//mass').get('value')) == vehicle.mass
    inertia = root.find('.//inertia')
    assert tuple(float(inertia.get(name)) for name in ('ixx', 'iyy', 'izz')) == vehicle.inertia
    assert len(root.findall('.//inertial')) == 1


def test_joints_are_the_static_frames_and_make_one_tree():
    root = ElementTree.fromstring(urdf(VEHICLE, marker_places(), 'mambo1/'))
    joints = root.findall('joint')
    assert [(joint.find('parent').get('link'), joint.find('child').get('link'))
            for joint in joints] == [(f'mambo1/{frame.parent}', f'mambo1/{frame.name}')
                                     for frame in static_frames(VEHICLE, marker_places())]
    for joint, frame in zip(joints, static_frames(VEHICLE, marker_places())):
        assert joint.get('type') == 'fixed'
        for key, values in (('xyz', frame.position), ('rpy', frame.rpy)):
            assert tuple(map(float, joint.find('origin').get(key).split())) == pytest.approx(
                values, abs=1e-9)
    links = [link.get('name') for link in root.findall('link')]
    assert len(links) == len(set(links)) == len(joints) + 1
    assert {joint.find('child').get('link') for joint in joints} == set(links) - {
        'mambo1/base_link'}


def test_meshes_exist_and_scale_with_the_vehicle():
    vehicle = preset('crazyflie')
    found = ElementTree.fromstring(urdf(vehicle)).findall('.//mesh')
    assert len(found) == 5
    for mesh in found:
        package, _, name = mesh.get('filename').removeprefix('package://').partition('/')
        assert package == PACKAGE.name
        assert (PACKAGE / 'mambo_description' / name).is_file()
    body, rotor = found[0].get('scale').split()[0], found[1].get('scale').split()[0]
    assert float(body) == pytest.approx(vehicle.arm / meshes.ARM)
    assert float(rotor) == vehicle.rotor.radius


def test_the_command_prints_or_writes_it(capsys, tmp_path):
    assert main([]) == 0
    assert capsys.readouterr().out == urdf(VEHICLE, marker_places())
    file = tmp_path / 'drone.urdf'
    assert main(['--vehicle', 'toolbox', '--prefix', 'a/', '--mesh-files', '-o', str(file)]) == 0
    mesh = ElementTree.fromstring(file.read_text()).find('.//mesh').get('filename')
    assert Path(mesh.removeprefix('file://')).read_bytes()
    assert 'a/base_link' in file.read_text()


@pytest.mark.parametrize('words, line', [
    (['--vehicle', 'bee'], "vehicle 'bee' is unknown; known: "),
    (['--prefix', 'a b/'], "prefix 'a b/' must be letters, digits and _, such as mambo1/"),
    (['--prefix', '/'], "prefix '/' must be letters")])
def test_wrong_input_gets_one_line(words, line, capsys):
    assert main(words) == 2
    error = capsys.readouterr().err
    assert line in error and error.count('\n') == 1
