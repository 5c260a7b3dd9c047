"""
Write the URDF of a vehicle: ``mambo urdf``, for RViz, robot_state_publisher and simulators.

Mass, inertia, arm and rotor radius are those of the vehicle; the frames are those of
``/tf_static``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from xml.etree import ElementTree

from mambo_bags.command import guard, Parser
from mambo_model import schema
from mambo_model.motion.vector import Vec3
from mambo_model.vehicle import parameters
from mambo_model.vehicle.parameters import PRESETS, Vehicle
from mambo_model.whole_file import refuse_existing, write_text

from . import meshes
from .static_frames import BASE, Frame, static_frames

PACKAGE = 'package://mambo_description/meshes'
MARKED = 'identified_markers'
"""Vehicle whose markers are on every drone of the simulated hall."""
_BODY, _ROTOR = '0.2 0.22 0.25 1', '0.85 0.35 0.1 1'  # red green blue opacity


def marker_places() -> list[Vec3]:
    """Return the place of each marker of the simulated hall, m, body FRD."""
    return [at for _, at in parameters.markers(MARKED)]


def _numbers(values: Sequence[float]) -> str:
    return ' '.join(f'{value:.12g}' for value in values)


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _visual(link: ElementTree.Element, file: str, scale: Sequence[float], colour: str) -> None:
    """Give a link its mesh."""
    visual = _add(link, 'visual')
    _add(_add(visual, 'geometry'), 'mesh', filename=file, scale=_numbers(scale))
    _add(_add(visual, 'material', name=file.rpartition('/')[2].removesuffix('.stl')), 'color',
         rgba=colour)


def _base(robot: ElementTree.Element, vehicle: Vehicle, prefix: str, folder: str) -> None:
    """Add the body, which has all the mass: the model knows one rigid body."""
    link, scale = _add(robot, 'link', name=prefix + BASE), vehicle.arm / meshes.ARM
    _visual(link, f'{folder}/body.stl', (scale,) * 3, _BODY)
    collision = _add(_add(link, 'collision'), 'geometry')
    wide = 2.0 * (vehicle.arm + vehicle.rotor.radius)
    _add(collision, 'box', size=_numbers((wide, wide, scale * meshes.HEIGHT)))
    inertial = _add(link, 'inertial')
    _add(inertial, 'mass', value=f'{vehicle.mass:.9g}')
    ixx, iyy, izz = (f'{moment:.9g}' for moment in vehicle.inertia)
    _add(inertial, 'inertia', ixx=ixx, iyy=iyy, izz=izz, ixy='0', ixz='0', iyz='0')


def _joint(robot: ElementTree.Element, frame: Frame, prefix: str) -> None:
    """Add the fixed joint of a frame."""
    joint = _add(robot, 'joint', name=f'{prefix}{frame.name}_joint', type='fixed')
    _add(joint, 'parent', link=prefix + frame.parent)
    _add(joint, 'child', link=prefix + frame.name)
    _add(joint, 'origin', xyz=_numbers(frame.position), rpy=_numbers(frame.rpy))


def urdf(vehicle: Vehicle, markers: Sequence[Vec3] = (), prefix: str = '',
         folder: str = PACKAGE) -> str:
    """
    Return the URDF of a vehicle.

    Parameters
    ----------
    vehicle
        Mass, inertia, arm and rotor radius.
    markers : (n, 3) m
        Place of each marker, body FRD.
    prefix
        Put before the name of every link and joint, such as ``mambo1/``.
    folder
        Address of the folder with the meshes.

    """
    robot = ElementTree.Element('robot', name=f'{prefix}mambo'.replace('/', '_'))
    _base(robot, vehicle, prefix, folder)
    for frame in static_frames(vehicle, markers):
        link = _add(robot, 'link', name=prefix + frame.name)
        if frame.name.startswith('rotor_'):
            _visual(link, f'{folder}/rotor.stl', (vehicle.rotor.radius,) * 3, _ROTOR)
        elif frame.name.startswith('marker_'):
            _add(_add(_add(link, 'visual'), 'geometry'), 'sphere', radius='0.0015')
        _joint(robot, frame, prefix)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding='unicode') + '\n'


def check_prefix(prefix: str) -> str:
    """Return a prefix of frames; ParameterError if it cannot be part of a frame's name."""
    if prefix and not all(part.isidentifier() and part.isascii()
                          for part in prefix.removesuffix('/').split('/')):
        raise schema.ParameterError(
            f'prefix {schema.shown(prefix)} must be letters, digits and _, such as mambo1/')
    return prefix


def _run(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    folder = meshes.FOLDER.as_uri() if options.mesh_files else PACKAGE
    text = urdf(parameters.find(options.vehicle), marker_places(), check_prefix(options.prefix),
                folder)
    if options.output is None:
        print(text, end='')
        return
    write_text(options.output, text)
    print(f'urdf: {options.output}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('urdf', __doc__)
    add = out.add_argument
    out.complete(PRESETS, add(
        '--vehicle', metavar='NAME', default='identified',
        help=f"one of: {', '.join(PRESETS)}, or a file (default: identified)"))
    add('--prefix', metavar='TEXT', default='',
        help='put before the name of every link, such as mambo1/ (default: none)')
    add('--mesh-files', action='store_true',
        help='address the meshes as files of this machine, for programs without ROS')
    out.add_output('FILE', 'file to write (default: print it)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``urdf``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('urdf', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
