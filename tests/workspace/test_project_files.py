"""The files that only a host of repositories or a container reads agree with the workspace."""

import json
from pathlib import Path
import re
import shutil
import subprocess

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PACKAGES = sorted((ROOT / 'src').glob('*/package.xml'))


def read_yaml(path):
    return yaml.safe_load((ROOT / path).read_text())


def supported_pythons():
    """Return the minor versions that the installation accepts, as (3, 10) <= ... <= (3, 13)."""
    text = (ROOT / 'tools/install.bash').read_text()
    low, high = re.search(r'\(3, (\d+)\) <= .* <= \(3, (\d+)\)', text).groups()
    return [f'3.{minor}' for minor in range(int(low), int(high) + 1)]


def test_the_workflow_tests_every_supported_python():
    jobs = read_yaml('.github/workflows/test.yml')['jobs']
    assert jobs['wheels']['strategy']['matrix']['python'] == supported_pythons()


def test_the_workflow_runs_what_integration_runs():
    for job in read_yaml('.github/workflows/test.yml')['jobs'].values():
        assert job['steps'][-1] == {'run': '.ci/run'}
        assert job['timeout-minutes'] <= 90


@pytest.mark.parametrize('path', ['CONTRIBUTING.md', '.github/pull_request_template.md'])
def test_a_change_and_a_release_need_what_integration_runs(path):
    assert '`./test` and `./test --long` pass' in (ROOT / path).read_text()


@pytest.mark.parametrize('long, tests, expected', [(0, 0, 0), (3, 0, 3), (0, 2, 2), (3, 2, 2)])
def test_integration_runs_every_test_and_fails_if_one_does(tmp_path, long, tests, expected):
    (tmp_path / '.ci').mkdir()
    shutil.copy(ROOT / '.ci/run', tmp_path / '.ci/run')
    told = tmp_path / 'test'
    told.write_text(f'#!/bin/sh\necho "test $*"\n[ "$1" = --long ] && exit {long}\n'
                    f'exit {tests}\n')
    told.chmod(0o755)
    done = subprocess.run([tmp_path / '.ci/run'], stdout=subprocess.PIPE, text=True, timeout=60)
    again = 'of ./test --long:\ntest --long\n' if long else ''
    assert (done.stdout, done.returncode) == (f'test --long\ntest \n{again}', expected)


def apt_packages(text):
    found = re.search(r'apt-get install -y ([^&]*?)(?:&&|\n *- |\Z)', text.replace('\\\n', ''))
    return {word for word in found[1].split() if not word.startswith('-')}


def test_the_containers_install_the_same_packages():
    docker = (ROOT / 'Dockerfile').read_text()
    job = read_yaml('.github/workflows/test.yml')['jobs']['apt']
    assert f'FROM {job["container"]["image"]}\n' in docker
    assert apt_packages(docker) == apt_packages(job['steps'][0]['run'])


def test_the_container_has_what_the_installation_asks_for():
    asked = set(re.findall(
        r'ros-jazzy-[a-z0-9-]+|build-essential|python3-venv|python3-dev',
        (ROOT / 'tools/install.bash').read_text()))
    assert asked - {'ros-jazzy-'} <= apt_packages((ROOT / 'Dockerfile').read_text())


def test_no_folder_that_is_made_goes_into_the_container():
    ignored = (ROOT / '.dockerignore').read_text().split()
    for made in (ROOT / '.gitignore').read_text().split():
        if made.endswith('/') and made[0] != '!':
            assert made.strip('/') in [name.removeprefix('**/') for name in ignored]


def test_the_development_container_is_the_container():
    made = json.loads((ROOT / '.devcontainer/devcontainer.json').read_text())
    assert (ROOT / '.devcontainer' / made['build']['dockerfile']).resolve() == ROOT / 'Dockerfile'
    assert f'USER {made["remoteUser"]}\n' in (ROOT / 'Dockerfile').read_text()


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.parent.name)
def test_every_package_has_the_version_of_the_citation(package):
    version = read_yaml('CITATION.cff')['version']
    assert f'<version>{version}</version>' in package.read_text()
    setup = package.with_name('setup.py')
    assert not setup.exists() or f"version='{version}'" in setup.read_text()


def test_the_hook_is_the_ruff_of_the_workspace():
    [hook] = read_yaml('.pre-commit-config.yaml')['repos'][0]['hooks']
    command, *arguments = hook['entry'].split()
    done = subprocess.run(
        [ROOT / command, *arguments, __file__], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize('form', ['bug', 'recording'])
def test_forms_have_questions_with_labels(form):
    asked = read_yaml(f'.github/ISSUE_TEMPLATE/{form}.yml')
    assert asked['name'] and asked['description']
    for question in asked['body']:
        assert question['type'] in {'input', 'textarea'} and question['attributes']['label']


def test_what_contributors_are_told_to_run_exists():
    text = (ROOT / 'CONTRIBUTING.md').read_text()
    for path in re.findall(r'\]\(([^)#]+)\)|`\.?/?(tests/[\w/.]+|tools/[\w.]+)`', text):
        assert (ROOT / (path[0] or path[1])).exists(), path
    for command in re.findall(r'`?\./(\w+)', text):
        assert (ROOT / command).exists(), command
