"""Components of files in the graph: the numbers of the closed loop, and a fault that is landed."""

from pathlib import Path

from mambo_bags.reader import read_bag
from mambo_bringup.flight.outcome import FlightEndedError
from mambo_bringup.flight.runner import fly
from mambo_flight import closed_loop, recording_to_bag, scenario_file
from mambo_flight.scenario import override, Place, scenario
from mambo_flight.sweep import design
from mambo_ros import topics
import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / 'examples'
PD = EXAMPLES / 'pd_controller.py'
LOCKSTEP = {'sim_node.mode': 'lockstep'}


@pytest.mark.long
def test_the_four_of_ones_own_are_the_closed_loop_to_the_bit(tmp_path):
    """A compiled controller, a plain estimator, a course and a vehicle, from files."""
    short = {'duration': Place(9.0, 'test'), 'landing': Place(False, 'test')}
    _, flight = scenario_file.load(str(EXAMPLES / 'yours.yaml'), short)
    flight = override(flight, LOCKSTEP)
    assert flight.sim_node.simulator.vehicle.mass == 0.074
    fly(flight, tmp_path / 'graph', composed=True)
    recording_to_bag.write(tmp_path / 'alone', flight, closed_loop.fly(flight, inner=True))
    graph, alone = (read_bag(tmp_path / name) for name in ('graph', 'alone'))
    for topic in topics.RECORDED:
        name = topic.name if topic.name.startswith('/') else f'/mambo/{topic.name}'
        assert graph[name].raw and graph[name].raw == alone[name].raw, name
    for source in ('alpha_beta_filter 1.1', 'pd_controller 1.0', '# figure_eight.csv'):
        assert f'{source}, sha256 ' in str(graph.attachments['scenario.yaml'])
    height, wanted = (graph[name].position[:, 2] for name in ('ground_truth/odom', 'reference'))
    assert height[-1] == pytest.approx(wanted[-1], abs=0.15) and 1.3 < wanted[-1] < 1.4


def test_a_sweep_varies_the_four_of_ones_own():
    flights = design.Flights(design.read(EXAMPLES / 'yours_sweep.yaml'))
    assert len(flights) == 12
    last = flights[11]
    assert last.controller_node.pd_controller.position_gain == 6.0
    assert last.estimator_node.alpha_beta_filter.alpha == 0.4 and last.seed == 3
    assert last.reference_node.plan.course == flights[0].reference_node.plan.course != ''
    assert last.sim_node.simulator.vehicle.mass == 0.074


@pytest.mark.long
@pytest.mark.parametrize('composed', [False, True])
def test_one_that_raises_is_landed_and_ends_the_flight_with_its_line(tmp_path, composed):
    broken = tmp_path / 'broken.py'
    broken.write_text(f'# {composed}\n' + PD.read_text().replace('@jit\n', '').replace(
        'return Memory(memory.steps + 1), thrust',
        "if memory.steps > 600:\n        raise RuntimeError('lost my way')\n"
        '    return Memory(memory.steps + 1), thrust'))
    flight = scenario(controller=str(broken), estimator='ground_truth', duration=9.0, land=False,
                      overrides=LOCKSTEP)
    with pytest.raises(FlightEndedError, match=r'broken.py:\d+: RuntimeError: lost my way') as end:
        fly(flight, tmp_path / 'bag', composed)
    outcome, = end.value.outcomes
    assert outcome.closed and outcome.whole and outcome.flown == pytest.approx(9.0)
    truth = read_bag(tmp_path / 'bag')
    height = np.asarray(truth['/mambo/ground_truth/odom']['pose.pose.position.z'])
    assert height.max() > 1.0 and abs(height[-1]) < 0.05
