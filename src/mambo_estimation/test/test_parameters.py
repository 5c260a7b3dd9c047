"""Parameters of the estimator: the filter is that of the chosen estimator."""

from mambo_estimation.parameters import EstimatorNodeParams
from mambo_model.schema import ParameterError
import pytest


@pytest.mark.parametrize('name', ['kalman', 'joint', 'toolbox'])
def test_the_filter_is_that_of_the_chosen_estimator(name):
    node = EstimatorNodeParams(estimator=name)
    assert node.filter is getattr(node, name)


def test_with_the_ground_truth_there_is_a_filter_that_is_not_used():
    node = EstimatorNodeParams(estimator='ground_truth')
    assert node.filter is node.joint


@pytest.mark.parametrize(('name', 'value', 'wanted'), [
    ('estimator', 'magic', "estimator 'magic' is unknown"),
    ('synchronise', 'never', "synchronise = 'never'"),
    ('sensor_reliability', 'good', "sensor_reliability = 'good'")])
def test_what_cannot_be_is_refused_by_name(name, value, wanted):
    with pytest.raises(ParameterError, match=wanted):
        EstimatorNodeParams(**{name: value})
