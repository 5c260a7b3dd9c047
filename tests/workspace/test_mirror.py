"""
Tests mirror the modules: src/PKG/test/FOLDER/test_MODULE.py for every module with functions.

The amount of test is measured as lines that are not blank of all Python files in src/PKG/test,
over those of all Python files of the package, src/PKG/PKG; tests/ of the workspace do not count.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SRC = ROOT / 'src'
PACKAGES = sorted(path.parent.name for path in SRC.glob('*/setup.py'))
PROCESSES = 'src/mambo_bringup/test/test_processes.py'
NODE = 'src/mambo_ros/test/test_node.py'
CHECK = 'tests/graph/test_check_node.py'
SENDING = 'src/mambo_bringup/test/commanding/test_sending.py'
DRONES = 'src/mambo_flight/test/gym/test_vector_environment.py'
JOINT = 'src/mambo_estimation/test/joint/test_filter.py'
CAPTURE = 'src/mambo_flight/test/test_motion_capture.py'
HELD = {
    # processes and threads: tested by starting them
    'mambo_bringup/checking/check.py': CHECK,
    'mambo_bringup/checking/ends.py': CHECK,
    'mambo_bringup/checking/stand.py': CHECK,
    **{f'mambo_bringup/commanding/{name}.py': SENDING for name in (
        'follow', 'go_to', 'halt', 'land', 'pause', 'resume', 'set_parameters', 'single_step',
        'takeoff')},
    'mambo_bringup/flight/launch_actions.py': 'src/mambo_bringup/test/test_launch.py',
    'mambo_bringup/launching.py': 'src/mambo_bringup/test/test_launch.py',
    'mambo_bringup/node_group.py': PROCESSES,
    'mambo_bringup/watchdog.py': PROCESSES,
    'mambo_ros/endpoints.py': NODE,
    'mambo_ros/graph/exit_timer.py': PROCESSES,
    'mambo_ros/loop.py': NODE,
    'mambo_ros/process.py': NODE,
    'mambo_ros/graph/foreign.py': 'tests/graph/test_own_components.py',
    'mambo_ros/graph/peers.py': 'src/mambo_ros/test/graph/test_links.py',
    # parts of one compiled step: tested by what the step does
    'mambo_control/command.py': 'src/mambo_control/test/test_cascaded.py',
    'mambo_control/controllers.py': 'src/mambo_control/test/test_cascaded.py',
    'mambo_control/virtual_thrust.py': 'src/mambo_control/test/test_cascaded.py',
    # moved below the courses that are checked by it
    'mambo_control/commanded/demand.py': 'src/mambo_flight/test/course/test_feasibility.py',
    'mambo_control/safety.py': 'src/mambo_control/test/test_cascaded.py',
    'mambo_control/literature/drag_estimate.py':
        'src/mambo_control/test/literature/test_extended.py',
    'mambo_control/literature/flight.py':
        'src/mambo_control/test/literature/test_flatness_drag.py',
    'mambo_estimation/capture/aided.py': CAPTURE,
    'mambo_estimation/joint/joint_parameters.py': CAPTURE,
    'mambo_flight/smooth/forward_pass.py': 'src/mambo_flight/test/smooth/test_smoother.py',
    'mambo_estimation/filters.py': 'src/mambo_estimation/test/test_kalman.py',
    'mambo_estimation/joint/answer.py': JOINT,
    'mambo_estimation/joint/update.py': JOINT,
    'mambo_estimation/measurements/samples.py': 'src/mambo_estimation/test/test_kalman.py',
    'mambo_flight/gym/episode.py': DRONES,
    # components of the user: tested in a flight
    'mambo_model/slots.py': 'src/mambo_flight/test/test_own_components.py',
    # options: tested by the parts that they switch
    'mambo_model/vehicle/vehicle_options.py': 'src/mambo_model/test/test_drag_parts.py',
}
"""Modules without a test file of their own: the file that holds them, and why, above each."""
FLOORS = {'mambo_analysis': 0.8, 'mambo_bags': 0.8, 'mambo_flight': 0.8, 'mambo_signals': 0.8,
          'mambo_thesis': 0.8}
"""Least lines of test per line of code."""


def with_functions(package):
    """Return the modules of a package that have functions, below its folder; nodes aside."""
    folder = SRC / package / package
    for file in sorted(folder.rglob('*.py')):
        # a node runs in the graph: tests/graph starts each one
        if file.stem != '__init__' and not file.stem.endswith('_node') and any(
                isinstance(node, ast.FunctionDef) for node in ast.walk(ast.parse(
                    file.read_text()))):
            yield file.relative_to(folder)


def lines(folder):
    """Return how many lines of the Python files below a folder are not blank."""
    return sum(bool(line.strip()) for file in folder.rglob('*.py')
               for line in file.read_text().splitlines())


@pytest.mark.parametrize('package', PACKAGES)
def test_every_module_with_functions_has_a_test_file_of_its_name(package):
    missing = [f'src/{package}/test/{module.parent}/test_{module.name}'
               for module in with_functions(package)
               if not (SRC / package / 'test' / module.with_name(f'test_{module.name}')).exists()
               and f'{package}/{module.as_posix()}' not in HELD]
    assert not missing, 'write it, or name in HELD the file that holds the module, and why'


@pytest.mark.parametrize(('module', 'test'), HELD.items())
def test_an_exception_is_one_and_is_held_by_a_file_that_is_there(module, test):
    package, _, path = module.partition('/')
    assert (SRC / package / package / path).exists(), 'take it out of HELD'
    assert (ROOT / test).exists()
    own = SRC / package / 'test' / Path(path).with_name(f'test_{Path(path).name}')
    assert not own.exists(), 'has a test file of its own: take it out of HELD'


@pytest.mark.parametrize(('package', 'least'), FLOORS.items())
def test_a_package_has_enough_lines_of_test_for_a_line_of_code(package, least):
    ratio = lines(SRC / package / 'test') / lines(SRC / package / package)
    assert ratio >= least, f'{ratio:.2f} lines of test per line of code, {least} are wanted'
