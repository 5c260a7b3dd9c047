"""The environments as Gymnasium knows them."""

from importlib import import_module

import gymnasium
from mambo_flight.gym.registration import IDS, register
import pytest


@pytest.fixture(autouse=True)
def registered():
    register()


@pytest.mark.parametrize('name', IDS)
def test_every_id_makes_the_environment_of_its_task(name):
    spec = gymnasium.spec(name)
    assert spec.kwargs == {'task': IDS[name]}
    for entry in (spec.entry_point, spec.vector_entry_point):
        module, _, kind = entry.partition(':')
        assert hasattr(import_module(module), kind), entry


def test_single_and_vector_environments_are_different_classes():
    for name in IDS:
        spec = gymnasium.spec(name)
        assert spec.entry_point.endswith(':DroneEnv')
        assert spec.vector_entry_point.endswith(':DroneVectorEnv')


def test_registering_again_keeps_what_is_registered(recwarn):
    before = {name: gymnasium.spec(name) for name in IDS}
    register()
    assert all(gymnasium.spec(name) is spec for name, spec in before.items())
    assert not recwarn.list  # gymnasium warns of an id that it overrides
