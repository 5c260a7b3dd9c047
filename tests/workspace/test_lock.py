"""The locked versions satisfy the requirements, have hashes, and are what is installed."""

from importlib import metadata
import os
from pathlib import Path
import re
import sys

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / 'requirements'
PYTHONS = ['3.10', '3.11', '3.12', '3.13']
LOCKS = {f'python-{version}.txt': ['python', 'test', 'ros-jazzy', 'colcon'] for version in PYTHONS}
LOCKS |= {'uv.txt': ['uv'], 'cmake.txt': ['cmake']}


def requirements(name):
    """Return what a file of requirements asks for, with the files that it includes."""
    asked = []
    for line in (FOLDER / f'{name}.txt').read_text().splitlines():
        line = line.partition('#')[0].strip()
        if line.startswith('-r '):
            asked += requirements(line[3:].removesuffix('.txt'))
        elif line:
            asked.append(Requirement(line))
    return asked


def locked(name):
    """Return the version of each package of a lock file, after checking that it has hashes."""
    versions = {}
    for entry in re.split(r'\n(?=\S)', (FOLDER / 'lock' / name).read_text().strip()):
        first, *hashes = entry.replace('\\\n', '\n').split('\n')
        assert hashes and all(
            re.fullmatch(r'\s*--hash=sha256:[0-9a-f]{64}\s*', line) for line in hashes), entry
        package, version = first.partition(';')[0].split('==')
        versions[canonicalize_name(package)] = version.strip()
    return versions


@pytest.mark.parametrize('lock', LOCKS)
def test_every_requirement_is_locked_within_its_limits(lock):
    versions = locked(lock)
    for name in LOCKS[lock]:
        for wanted in requirements(name):
            version = versions.get(canonicalize_name(wanted.name))
            assert version and wanted.specifier.contains(version), \
                f'{wanted}: locked is {version}: tools/lock.bash'


def test_each_supported_python_has_its_lock():
    text = (ROOT / 'tools/install.bash').read_text()
    low, high = re.search(r'\(3, (\d+)\) <= .* <= \(3, (\d+)\)', text).groups()
    assert PYTHONS == [f'3.{minor}' for minor in range(int(low), int(high) + 1)]
    made = re.search(r'for version in (.*);', (ROOT / 'tools/lock.bash').read_text())[1].split()
    assert made == PYTHONS
    assert {path.name for path in (FOLDER / 'lock').iterdir()} == set(LOCKS)


@pytest.mark.skipif(os.environ.get('MAMBO_ROS') != 'wheels', reason='a ROS 2 of the system')
def test_what_is_installed_is_what_is_locked():
    there = {canonicalize_name(found.metadata['Name']): found.version
             for found in metadata.distributions()}
    versions = locked(f'python-{sys.version_info[0]}.{sys.version_info[1]}.txt')
    assert {name: there.get(name) for name in versions} == versions


@pytest.mark.skipif(os.environ.get('MAMBO_ROS') != 'wheels', reason='a ROS 2 of the system')
def test_the_lock_has_what_its_packages_need():
    """It is installed without looking at dependencies (tools/install.bash)."""
    versions = locked(f'python-{sys.version_info[0]}.{sys.version_info[1]}.txt')
    pending = [(name, '') for name in versions]
    seen, missing = set(), []
    while pending:
        name, extra = pending.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        for text in metadata.requires(name) or []:
            wanted = Requirement(text)
            if wanted.marker and not wanted.marker.evaluate({'extra': extra}):
                continue
            needed = canonicalize_name(wanted.name)
            if not wanted.specifier.contains(versions.get(needed, ''), prereleases=True):
                missing.append(f'{name}: {wanted}, locked is {versions.get(needed)}')
            else:
                pending += [(needed, option) for option in wanted.extras]
    assert not missing
