"""Common parts of the importers: source files, messages, and a bag with its origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import hashlib
import math
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags import columns
from mambo_bags.command import Parser
from mambo_bags.mcap_reader import BagError, read_file
from mambo_bags.writer import BagWriter
from mambo_model.yaml_nodes import dump
import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.typesys.store import Typestore
import yaml

NAMESPACE = '/mambo'
SECOND = 1_000_000_000
LONGEST = 1e9  # [s] of a time
LARGEST = 1e30  # of what is measured; some messages hold single precision
ESTIMATORS = Path(__file__).with_name('estimators')  # a parameter file for each vehicle
ONLY_CHANGES = 'only_changes'  # entry of the record ``import``: topics without repeated values
PACKAGES = {'Header': 'std_msgs', 'Time': 'builtin_interfaces'}


class Source(NamedTuple):
    """A file as it was read."""

    path: Path
    content: bytes
    sha256: str

    def text(self) -> str:
        """Return the content as text; BagError if it is not UTF-8."""
        try:
            return self.content.decode('utf-8-sig')
        except UnicodeDecodeError as error:
            raise BagError(f'{self.path}: not a text file in UTF-8 (byte {error.start}): save it '
                           'in this encoding') from None


def read_source(path: Path) -> Source:
    """Return a file's content and checksum; BagError if it cannot be read or is empty."""
    content = read_file(path)
    return Source(path, content, hashlib.sha256(content).hexdigest())


def provenance(
    name: str, sha256: str, importer: str, kind: str, details: Mapping[str, Any],
) -> dict[str, dict[str, str]]:
    """Return the metadata record ``import`` of a bag; numbers with nine digits."""
    def text(value: Any) -> str:
        return f'{value:.9g}' if isinstance(value, float) else str(value)

    return {'import': {
        'source_file': name, 'source_sha256': sha256,
        'importer': f'mambo_analysis.{importer}', 'source_kind': kind,
        **{key: text(value) for key, value in details.items()}}}


def estimator_parameters(
    vehicle: str, changes: Mapping[str, Mapping[str, Mapping[str, Any]]],
) -> dict[str, str]:
    """
    Return the estimator's parameter file of a bag, {'scenario.yaml': text}.

    Parameters
    ----------
    vehicle
        Name of a file in ``estimators/``: how noisy the sensors of this vehicle are.
    changes
        {estimator: {group: {parameter: value}}} of this log, over those of the file.

    """
    parameters = yaml.safe_load((ESTIMATORS / f'{vehicle}.yaml').read_text())
    node = parameters['estimator_node']['ros__parameters']
    for estimator, groups in changes.items():
        for group, values in groups.items():
            node.setdefault(estimator, {}).setdefault(group, {}).update(values)
    return {'scenario.yaml': dump({'/mambo/estimator_node': {'ros__parameters': node}})}


def shortened(names: Sequence[str], most: int = 12) -> str:
    """Return names in one line, and the number of names beyond ``most``."""
    more = f' and {len(names) - most} more' if len(names) > most else ''
    short = [name if len(name) <= 60 else f'{name[:57]}...' for name in names[:most]]
    return ', '.join(short) + more


def quoted(text: str) -> str:
    """Return a word of a file, for an error: in quotes, in one line, not too long."""
    return repr(text if len(text) <= 60 else f'{text[:57]}...')


def number(text: str) -> float:
    """
    Return a cell of a table as a number.

    Raises
    ------
    ValueError
        Quoting the cell, if it is not a number. Python would also read 1_000 and digits of other
        scripts; a table means something else by them.

    """
    try:
        if '_' in text or not text.isascii():
            raise ValueError
        return float(text)
    except ValueError:
        raise ValueError(f'{quoted(text)} is not a number') from None


def unused(names: Sequence[str]) -> list[str]:
    """Return a line about unused parts of the source; empty if all was used."""
    shown = [name or 'a column without a name' for name in names]
    return [f'not used: {shortened(shown)}'] if shown else []


def refuse_options(path: Path, given: Mapping[str, bool], reason: str) -> None:
    """
    Refuse options without effect on a file; of those of a command line alone see
    :func:`mambo_bags.command.refuse_unused`.

    Parameters
    ----------
    path
        Of the file.
    given
        {name of an option: whether it has another value than its default}.
    reason
        Why they have none, after "as".

    Raises
    ------
    BagError
        Naming the first that is given.

    """
    for name, is_given in given.items():
        if is_given:
            raise BagError(f'{path}: --{name}: has no effect, as {reason}: leave it out')


def new_samples(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the steps at which a held signal, (n,) or (n, k), takes a new value; never step 0."""
    changed = np.diff(values.reshape(len(values), -1), axis=0) != 0.0
    return np.flatnonzero(changed.any(axis=1)) + 1


def is_sound(values: NDArray[np.float64]) -> bool:
    """Return whether all numbers are finite, in single precision too."""
    return bool((np.abs(values) < LARGEST).all())


def stamps_ns(times: ArrayLike) -> NDArray[np.int64]:
    """Return seconds, (n,), as whole nanoseconds."""
    return np.rint(np.asarray(times, float) * 1e9).astype(np.int64)


class Publisher:
    """
    Builds the messages of one bag.

    Parameters
    ----------
    writer
        The bag; its topics are declared here.
    topics
        {name relative to the drone's namespace: type}.

    """

    def __init__(self, writer: BagWriter, topics: Mapping[str, str]) -> None:
        self._store: Typestore = columns.load_types(topics.values())
        self._writer, self._topics = writer, dict(topics)
        for topic, type_name in topics.items():
            writer.add_topic(f'{NAMESPACE}/{topic}', type_name)

    def make(self, name: str, *values: Any) -> Any:
        """Return a message of a common package with all its values."""
        return self._store.types[f'{PACKAGES.get(name, "geometry_msgs")}/msg/{name}'](*values)

    def header(self, stamp: int, frame: str = '') -> Any:
        """Return a header of a stamp in ns."""
        return self.make('Header', self.make('Time', *divmod(stamp, SECOND)), frame)

    def pose(self, position: Any, quaternion: Any) -> Any:
        """Return a pose from wire axes, x y z and x y z w."""
        return self.make(
            'Pose', self.make('Point', *position), self.make('Quaternion', *quaternion))

    def odometry(self, pose: Any, velocity: Any, omega: Any) -> dict[str, Any]:
        """Return the fields of an Odometry in base_link (FLU) whose covariance is not known."""
        make, unknown = self.make, np.zeros(36)
        twist = make('Twist', make('Vector3', *velocity), make('Vector3', *omega))
        return {'child_frame_id': 'base_link',
                'pose': make('PoseWithCovariance', pose, unknown),
                'twist': make('TwistWithCovariance', twist, unknown)}

    def imu(self, omega: Any, acceleration: Any) -> dict[str, Any]:
        """Return the fields of an Imu without orientation (REP-145), body FLU."""
        return {'orientation': self.make('Quaternion', 0.0, 0.0, 0.0, 1.0),
                'orientation_covariance': np.array([-1.0] + [0.0] * 8),
                'angular_velocity': self.make('Vector3', *omega),
                'linear_acceleration': self.make('Vector3', *acceleration)}

    def battery(self, voltage: float, percent: float) -> dict[str, Any]:
        """Return the fields of a BatteryState of which only V and % are known."""
        unknown = math.nan
        return {'voltage': voltage, 'percentage': percent / 100.0, 'present': True,
                'temperature': unknown, 'current': unknown, 'charge': unknown,
                'capacity': unknown, 'design_capacity': unknown}

    def publish(self, topic: str, stamp: int, frame: str, **fields: Any) -> None:
        """Write a message whose other fields are 0."""
        name = self._topics[topic]
        message = columns.zero(self._store, name, header=self.header(stamp, frame), **fields)
        # held back, as far as memory allows, because a log is read topic by topic
        self._writer.write(
            f'{NAMESPACE}/{topic}', bytes(self._store.serialize_cdr(message, name)), stamp,
            now_ns=0)


def importer_parser(name: str, description: str, source: str, help: str) -> Parser:
    """
    Return the command line of an importer, with the file to read and the bag to create.

    Parameters
    ----------
    name
        Name of the command.
    description
        Its docstring, of which the first paragraph is shown.
    source, help
        Name and description of the argument that is read.

    """
    out = Parser(name, description.split('\n\n')[0])
    out.add_argument(source, type=Path, help=help)
    out.add_output('BAG', 'bag to create', required=True, positional=True)
    return out


def report(source: Path, target: Path, counts: Mapping[str, int], *notes: str) -> None:
    """Print the summary of an import."""
    print(f'imported {source.name} into {target}')
    for topic, count in counts.items():
        print(f'  {count:6d}  {topic}')
    for note in notes:
        print(f'  {note}')
