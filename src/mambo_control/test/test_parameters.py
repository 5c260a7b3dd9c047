"""Parameters of controller and reference: the law is that of the chosen controller."""

from mambo_control.gains import CascadedParams
from mambo_control.parameters import ControllerNodeParams
from mambo_model.schema import ParameterError
import pytest


def test_the_law_is_that_of_the_chosen_controller():
    node = ControllerNodeParams(cascaded=CascadedParams(k_p=3.0))
    assert node.law is node.cascaded and node.law.k_p == 3.0
    other = ControllerNodeParams(controller='toolbox')
    assert other.law is other.toolbox and other.law is not other.cascaded


@pytest.mark.parametrize(('name', 'value', 'wanted'), [
    ('controller', 'magic', "controller 'magic' is unknown"), ('period', 0.0, 'period = 0.0 s'),
    ('patience', -1.0, 'patience = -1.0 s')])
def test_what_cannot_be_is_refused_by_name(name, value, wanted):
    with pytest.raises(ParameterError, match=wanted):
        ControllerNodeParams(**{name: value})
