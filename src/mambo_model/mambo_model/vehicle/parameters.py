"""
Parameters of the vehicle, used for the true vehicle and for the model in the controller.

They are the numbers of (3.1)-(3.3), (3.13), (4.4), (4.5) and (4.7), with unit, range and source.
Known vehicles are files in the folder ``presets``: see :func:`preset` and :func:`load`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from dataclasses import dataclass
from pathlib import Path

from . import vehicle_file
from ..motion.vector import Vec3
from ..schema import choice, group, ParameterError, quantity, shown
from ..values import Parameters, values, values_type
from .mass_properties import impossible, Point, with_points
from .vehicle_options import (
    BatteryParams, DragParams, FadeParams, GroundEffectParams, RotorParams)

THRUST_MAPS = ('linear', 'power')
THRUST_LINEAR, THRUST_POWER = range(len(THRUST_MAPS))

DRAG_READINGS = ('none', 'per_rotor_thrust', 'total_thrust', 'force', 'acceleration')
DRAG_NONE, DRAG_PER_ROTOR, DRAG_TOTAL, DRAG_FORCE, DRAG_ACCELERATION = range(len(DRAG_READINGS))

FOLDER = Path(__file__).with_name('presets')
MAX_PRODUCT = 0.02   # of inertia, over the least moment: what the model of principal axes ignores
MAX_SHIFT = 1e-3     # m, of the centre of mass away from the middle of the rotors, likewise


@dataclass(frozen=True)
class Vehicle(Parameters):
    """
    Parrot Mambo as identified: weighed mass, pendulum inertia, measured motor map, rotor drag.

    The inertia is used as published, although its largest value exceeds the sum of the other two
    by 2 %. That is within the spread of the measurement.
    """

    mass: float = quantity(0.068, 'kg', 0.01, 1.0, 'weighed, thesis sec. 4.4')
    inertia: Vec3 = quantity(
        (0.69e-4, 0.775e-4, 1.5e-4), 'kg m^2', 1e-6, 1e-2,
        'bifilar pendulum, thesis table 4.2; principal axes along body axes')
    gravity: float = quantity(9.81, 'm/s^2', 9.7, 9.9, 'standard value; the thesis gives none')
    arm: float = quantity(
        0.0441234, 'm', 0.005, 0.5,
        'rotor to body x and y axes, (3.2): 1/(4 * 5.66592) of the support package, (4.4)')
    yaw_ratio: float = quantity(
        0.00241374, 'm', 1e-4, 0.1,
        'yaw torque per thrust, d of (3.2): 1/(4 * 103.573624) of the support package, (4.4)')
    thrust_map: str = choice('power', THRUST_MAPS, 'PWM to thrust: (4.5) or 1/linear_gain')
    linear_gain: float = quantity(
        1530.72681, 'PWM/N', 100.0, 1e6, 'support package, thesis sec. 4.4.2')
    power_a: float = quantity(4.29e-5, 'N', 1e-18, 1e-2, 'a of (4.5), thesis sec. 4.4.2')
    power_b: float = quantity(1.47, '1', 0.5, 3.0, 'b of (4.5), thesis sec. 4.4.2')
    pwm_min: float = quantity(10.0, 'PWM', 0.0, 65535.0, 'limit in the support package')
    pwm_max: float = quantity(500.0, 'PWM', 1.0, 65535.0, 'limit in the support package')
    motor_time_constant: float = quantity(
        0.0, 's', 0.0, 1.0, 'none identified; 0 makes thrust follow at once')
    drag_reading: str = choice(
        'per_rotor_thrust', DRAG_READINGS,
        'meaning of T in (3.13); only the thrust of one rotor agrees with (3.11) and (3.12)')
    drag_coefficient: float = quantity(
        0.22, 's/m', 0.0, 10.0,
        'k_c, thesis sec. 6.3; kg/s under the reading force, 1/s under acceleration')
    vertical_drag_coefficient: float = quantity(
        0.0, 's/m', 0.0, 10.0,
        'as drag_coefficient, along b3; (3.13) has none, chapter 7 asks for it')
    air_density: float = quantity(
        1.184, 'kg/m^3', 0.1, 2.0, 'air of 25 deg C at sea level: toolbox of the Rolling Spider')
    rotor: RotorParams = group(RotorParams)
    drag: DragParams = group(DragParams)
    ground_effect: GroundEffectParams = group(GroundEffectParams)
    fade: FadeParams = group(FadeParams)
    battery: BatteryParams = group(BatteryParams)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.pwm_min < self.pwm_max:
            raise ParameterError(
                f'pwm_min = {self.pwm_min:g} PWM must be below '
                f'pwm_max = {self.pwm_max:g} PWM')
        if self.rotor.torques and not self.motor_time_constant > 0.0:
            raise ParameterError(
                'rotor.torques = True needs a motor_time_constant above 0 s, 0.05 s say: '
                'rotors that jump to their speed kick the vehicle')

    def options(self) -> OptionValues | None:
        """
        Return the options of the plant, which controllers do not know; None if none is enabled.

        None has another type, so code compiled for a vehicle without options does not contain
        them.
        """
        d = self.drag
        parts = d.blade_flapping or d.induced or d.translational or d.parasitic
        if not (parts or d.profile != 'none' or self.rotor.torques or self.ground_effect.enabled
                or self.fade.enabled or self.battery.enabled):
            return None
        return values(self, OptionValues)


_OPTIONS = ('air_density', 'rotor', 'drag', 'ground_effect', 'fade', 'battery')
VehicleValues = values_type(Vehicle, without=_OPTIONS)  # what controllers know as well
OptionValues = values_type(Vehicle, 'Options', only=_OPTIONS)


def with_markers(vehicle: Vehicle, markers: Sequence[Point]) -> Vehicle:
    """
    Return the vehicle with point masses on it, such as the markers of a motion capture.

    Mass and inertia follow by the parallel-axis theorem.

    Parameters
    ----------
    vehicle
        The vehicle without markers.
    markers
        Mass in kg and position in m from the centre of mass, body FRD, of each marker.

    Raises
    ------
    ParameterError
        If they tilt the principal axes or shift the centre of mass sideways by more than the
        model, which has neither, may neglect.

    """
    mass, centre, J = with_points(vehicle.mass, vehicle.inertia, markers)
    moments = (J[0][0], J[1][1], J[2][2])
    product = max(abs(J[0][1]), abs(J[0][2]), abs(J[1][2]))
    if product > MAX_PRODUCT * min(moments):
        raise ParameterError(
            f'markers cause a product of inertia of {product:.2g} kg m^2, more than '
            f'{100.0 * MAX_PRODUCT:g} % of the least moment: place them more evenly')
    shift = max(abs(centre[0]), abs(centre[1]))
    if shift > MAX_SHIFT:
        raise ParameterError(
            f'markers move the centre of mass by {1000.0 * shift:.2g} mm, more than '
            f'{1000.0 * MAX_SHIFT:g} mm: place them more evenly')
    return dataclasses.replace(vehicle, mass=mass, inertia=moments)


def load(path: str | Path) -> Vehicle:
    """
    Read a vehicle from a file like those in the folder ``presets``.

    Parameters
    ----------
    path
        A YAML file with ``description``, ``base`` (name of the vehicle to start from; without it,
        the defaults of :class:`Vehicle`), ``markers``, and values under the names of
        :class:`Vehicle`, each with ``value``, ``unit`` (if it has one) and ``source``.

    Raises
    ------
    ParameterError
        If something is missing, unknown, in another unit or out of range, or if no body has such
        an inertia; the message names file, line and key.

    """
    return _load(Path(path), ())


def _load(path: Path, before: tuple[Path, ...]) -> Vehicle:
    """Read a file and its base; ``before`` are the files that have this one as their base."""
    if path in before:
        raise ParameterError(f'{path}: base: vehicles that start from each other')
    content = vehicle_file.read(path, Vehicle)
    start = Vehicle()
    if content.base is not None:
        base = FOLDER / f'{content.base.value}.yaml'
        if content.base.value not in PRESETS:
            raise ParameterError(f'{content.base.where}: {_unknown(content.base.value)}')
        start = _load(base, (*before, path))
    if 'inertia' in content.values and (why := impossible(content.values['inertia'])):
        raise ParameterError(f'{content.places["inertia"]}: inertia: {why}')
    try:
        out = vehicle_file.replace(start, content.values)
        return with_markers(out, content.markers) if content.markers else out
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from None


def markers(name: str) -> list[Point]:
    """Return mass in kg and position in m of each marker of a known vehicle."""
    return vehicle_file.read(FOLDER / f'{name}.yaml', Vehicle).markers


class _Presets(Mapping[str, Vehicle]):
    """The vehicles in the folder by the names of their files; each is read on first use."""

    def __init__(self, folder: Path) -> None:
        self._files = {path.stem: path for path in sorted(folder.glob('*.yaml'))}
        self._read: dict[str, Vehicle] = {}

    def __getitem__(self, name: str) -> Vehicle:
        if name not in self._read:
            self._read[name] = load(self._files[name])
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)

    def __contains__(self, name: object) -> bool:
        return name in self._files


PRESETS: Mapping[str, Vehicle] = _Presets(FOLDER)


def _unknown(name: str) -> str:
    return f'vehicle {shown(name)} is unknown; known: {", ".join(PRESETS)}'


def preset(name: str) -> Vehicle:
    """
    Return a known vehicle by the name of its file, such as ``identified`` or ``toolbox``.

    Raises
    ------
    ParameterError
        If the name is unknown; the message lists the known vehicles.

    """
    if name not in PRESETS:
        raise ParameterError(_unknown(name))
    return PRESETS[name]


def find(name: str, folder: Path = Path()) -> Vehicle:
    """
    Return a known vehicle or the vehicle of a file.

    Parameters
    ----------
    name
        A name as for :func:`preset`, or a path that ends in ``.yaml`` as for :func:`load`.
    folder
        Folder that a path is relative to.

    Raises
    ------
    ParameterError
        As for :func:`preset` and :func:`load`.

    """
    return load(folder / name) if Path(name).suffix in ('.yaml', '.yml') else preset(name)
