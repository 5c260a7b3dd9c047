"""The rules that keep the numbers free of ROS and the packages in their order."""

import ast
import configparser
from pathlib import Path
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

SRC = Path(__file__).parents[2] / 'src'
PACKAGES = sorted(path.parent.name for path in SRC.glob('*/setup.py'))

# What each package may import of the others, from the lowest up. A sensor and the filter's
# prediction of it are separate code, or a wrong sign would be invisible: sim, estimation and
# control never import each other. Bags know messages, but nothing of what flies.
WIRE = {'mambo_interfaces', 'mambo_ros'}
LAWS = {'mambo_control', 'mambo_estimation', 'mambo_sim'}
BELOW = {
    'mambo_model': set(),
    'mambo_ros': {'mambo_interfaces', 'mambo_model'},
    'mambo_sim': {'mambo_model'},
    'mambo_estimation': {'mambo_model'},
    'mambo_control': {'mambo_model'},
    'mambo_bags': WIRE | {'mambo_model'},
}
BELOW['mambo_mocap'] = {'mambo_model', 'mambo_sim'}
BELOW['mambo_flight'] = LAWS | BELOW['mambo_bags'] | {'mambo_bags'}
BELOW['mambo_view'] = BELOW['mambo_flight'] | {'mambo_flight'}
BELOW['mambo_description'] = WIRE | {'mambo_model', 'mambo_bags', 'mambo_view'}
BELOW['mambo_signals'] = BELOW['mambo_bags'] | {'mambo_bags'}
BELOW['mambo_analysis'] = BELOW['mambo_flight'] | {'mambo_flight', 'mambo_signals'}
BELOW['mambo_thesis'] = BELOW['mambo_analysis'] | {'mambo_analysis'}
BELOW['mambo_bringup'] = BELOW['mambo_thesis'] | {
    'mambo_thesis', 'mambo_view', 'mambo_description'}
BELOW['mambo'] = BELOW['mambo_analysis'] | {'mambo_analysis'}
HOLD_MESSAGES = {
    'mambo', 'mambo_bags', 'mambo_flight', 'mambo_analysis', 'mambo_signals', 'mambo_thesis',
    'mambo_view', 'mambo_description'}
MOST = 0.26  # of all lines, in one package
LONGEST = 200  # lines of a file that imports rclpy

# The packages of ROS that run a graph, and those that only hold messages, which bags hold too.
ROS = {'ament_index_python', 'launch', 'launch_ros', 'rclpy', 'rosbag2_py', 'tf2_ros'}
ROS_MESSAGES = {'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs',
                'rcl_interfaces', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs',
                'tf2_msgs', 'visualization_msgs'}
# rosdep's name of what Python imports under another; None where rosdep has none, or for extras
ROSDEP = {'argcomplete': 'python3-argcomplete', 'clarabel': None, 'distributed': None,
          'gymnasium': None, 'h5py': None, 'llvmlite': 'python3-numba', 'lz4': None,
          'matplotlib': 'python3-matplotlib', 'mcap': None, 'msgspec': None,
          'numba': 'python3-numba', 'numpy': 'python3-numpy', 'osqp': None,
          'pandas': 'python3-pandas', 'plotly': None, 'pyarrow': None, 'pyulog': None,
          'rosbags': None,
          'scipy': 'python3-scipy',
          'tqdm': 'python3-tqdm', 'viser': None, 'websockets': None,
          'yaml': 'python3-yaml', 'zstandard': None}


def modules(package):
    """Return the source files of a package."""
    return sorted((SRC / package / package).rglob('*.py'))


def imported(file):
    """Return the names of the top-level packages that a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add(node.module.split('.')[0])
    return names


def is_node(file):
    return file.stem.endswith('_node')


def forbidden(file, package):
    """Return the packages of ROS that a file must do without."""
    if is_node(file) or package in ('mambo_ros', 'mambo_bringup'):
        return set()
    return ROS if package in HOLD_MESSAGES else ROS | ROS_MESSAGES


def test_the_rules_cover_every_package():
    assert set(BELOW) == set(PACKAGES)
    assert sum(len(modules(package)) for package in PACKAGES) > len(PACKAGES)


@pytest.mark.parametrize('package', PACKAGES)
def test_a_package_imports_only_those_below_it(package):
    wrong = []
    for file in modules(package):
        allowed = BELOW[package] | {package} | (WIRE if is_node(file) else set())
        wrong += [f'{file.relative_to(SRC)} imports {name}' for name in imported(file) - allowed
                  if name.startswith('mambo_')]
    assert not wrong


def test_no_package_holds_most_of_the_code():
    lines = {package: sum(len(file.read_text().splitlines()) for file in modules(package))
             for package in PACKAGES}
    assert max(lines.values()) < MOST * sum(lines.values()), lines


def test_no_folder_is_crowded_and_no_name_stands_twice_in_a_package():
    for package in PACKAGES:
        files = [file for file in modules(package) if file.stem != '__init__']
        folders = [file.parent for file in files]
        assert max(map(folders.count, folders)) <= 15, package
        names = [file.name for file in files]
        assert not {name for name in names if names.count(name) > 1}, package


@pytest.mark.parametrize('package', PACKAGES)
def test_only_nodes_import_ros(package):
    assert not [f'{file.relative_to(SRC)} imports {name}' for file in modules(package)
                for name in imported(file) & forbidden(file, package)]


@pytest.mark.long
def test_what_runs_in_the_graph_is_short():
    """One concern a file: every node, and what cannot be imported without rclpy."""
    long = {}
    for file in (file for package in PACKAGES for file in modules(package)):
        if is_node(file) or 'rclpy' in imported(file):
            long[str(file.relative_to(SRC))] = len(file.read_text().splitlines())
    assert len(long) > 10
    assert not {name: lines for name, lines in long.items() if lines > LONGEST}


@pytest.mark.parametrize('package', PACKAGES)
def test_the_manifest_names_what_the_code_imports(package):
    manifest = ElementTree.parse(SRC / package / 'package.xml').getroot()
    named = {node.text for tag in ('depend', 'exec_depend') for node in manifest.iter(tag)}
    used = set().union(*map(imported, modules(package)))
    foreign = used - set(sys.stdlib_module_names) - {package}
    unknown = {name for name in foreign if name not in ROSDEP and name not in ROS
               and name not in ROS_MESSAGES and not name.startswith('mambo_')}
    needed = {ROSDEP.get(name, name) for name in foreign} - {None}
    assert not unknown, 'add it to ROSDEP above and to requirements/python.txt'
    assert not needed - named, f'add to src/{package}/package.xml'
    # what a launch file or the flight runner starts is needed without being imported
    surplus = {name for name in named - needed if not name.startswith(('launch', 'mambo_'))}
    assert not surplus, f'take out of src/{package}/package.xml'


@pytest.mark.parametrize('package', PACKAGES)
def test_every_console_script_has_its_main(package):
    tree = ast.parse((SRC / package / 'setup.py').read_text())
    scripts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)
               and isinstance(node.value, str) and ':' in node.value and '=' in node.value]
    for script in scripts:
        module, function = script.split(' = ')[1].split(':')
        if module == 'mambo_ros.entry':  # which runs the main of the module behind the colon
            module, function = function, 'main'
        owner = module.split('.')[0]  # executables stay where they were when a module moves
        file = SRC / owner / Path(*module.split('.')).with_suffix('.py')
        names = [node.name for node in ast.parse(file.read_text()).body
                 if isinstance(node, ast.FunctionDef)]
        assert function in names, script
    nodes = {file.stem for file in modules(package) if is_node(file)}
    assert nodes <= {script.split(' = ')[0] for script in scripts}


@pytest.mark.parametrize('package', PACKAGES)
def test_executables_go_where_ros2_run_looks(package):
    settings = configparser.ConfigParser()
    settings.read(SRC / package / 'setup.cfg')
    folder = f'$base/lib/{package}'
    assert settings['develop']['script_dir'] == settings['install']['install_scripts'] == folder


@pytest.mark.long
@pytest.mark.parametrize('blocked', [ROS, ROS | ROS_MESSAGES], ids=['graph', 'messages'])
def test_everything_but_the_nodes_imports_without_ros(blocked):
    names = ['.'.join(file.relative_to(SRC / package).with_suffix('').parts)
             for package in PACKAGES for file in modules(package)
             if forbidden(file, package) >= blocked and file.stem != '__init__']
    block = f'import sys; sys.modules.update(dict.fromkeys({sorted(blocked)}))\n'
    code = block + '\n'.join(f'import {name}' for name in names)
    done = subprocess.run([sys.executable, '-c', code], text=True, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert len(names) > 20
