"""Commands of a running flight: scripted ones at their time, others at the next step."""

from mambo_control.commanded import timeline as tl
from mambo_control.commanded.command_params import CommandParams
from mambo_control.commanded.commander import Commander, FAILING, SHUT_DOWN
from mambo_model.motion import flight_command as fc
from mambo_model.motion.flight_command import FlightCommand
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

STEP = 5_000_000
P, V = CommandParams(script='- {time: 0.02, takeoff: {height: 1.0}}'), Vehicle()


def test_a_command_takes_effect_at_the_next_step_and_the_script_at_its_own():
    commander, seen = Commander(P, V), []
    assert commander.next_step == 0  # before the first
    for k in range(6):
        seen += [(k, command.t, reason) for command, reason in commander.advance(k * STEP)]
        assert commander.next_step == (k + 1) * STEP
    assert seen == [(4, 20_000_000, '')]
    commander.advance(199 * STEP)  # it has taken off
    given, reason = commander.give(FlightCommand(0, fc.STOP))
    assert (given.t, reason) == (200 * STEP, '') and commander.timeline.last == 200 * STEP


def test_a_script_whose_steps_were_left_out_keeps_its_times():
    commander = Commander(P, V)
    (command, reason), = commander.advance(10**9)
    assert (command.t, reason) == (20_000_000, '')


def test_a_refused_command_is_counted_and_changes_nothing():
    commander = Commander(CommandParams(), V)
    before = commander.timeline
    assert commander.give(FlightCommand(0, fc.LAND))[1] == (
        'the vehicle is on the floor: take off first')
    assert commander.refused == {'land': 1} and commander.timeline is before


def test_what_comes_after_a_shutdown_is_refused_and_the_script_goes_on():
    commander = Commander(P, V)
    before, commander.shut_down = commander.timeline, True
    assert commander.give(FlightCommand(0, fc.TAKEOFF, height=1.0))[1] == SHUT_DOWN
    assert commander.refused == {'takeoff': 1} and commander.timeline is before
    # as a flight in one process, which does not hear of it, makes the same reference
    assert [reason for _, reason in commander.advance(20_000_000)] == ['']


def test_while_a_failsafe_flies_commands_are_refused_but_a_takeoff():
    commander = Commander(CommandParams(), V)
    commander.failing = True
    assert commander.give(FlightCommand(0, fc.TAKEOFF, height=1.0))[1] == ''
    for kind in (fc.GO_TO, fc.LAND, fc.STOP):
        before = commander.timeline
        assert commander.give(FlightCommand(0, kind))[1] == FAILING
        assert commander.timeline is before
    commander.failing = False
    assert commander.give(FlightCommand(0, fc.LAND))[1] == ''


def test_the_accepted_commands_make_the_same_reference_again():
    commander, accepted, live = Commander(P, V), [], []
    for k in range(2000):
        accepted += [c for c, reason in commander.advance(k * STEP) if not reason]
        live.append(tl.state_of(commander.timeline, k * STEP * 1e-9))
        if k % 250 == 249:
            kind = fc.GO_TO if k % 500 == 249 else fc.STOP
            command, reason = commander.give(FlightCommand(
                0, kind, relative=True, position=(0.3, 0.1, 0.0)))
            accepted += [] if reason else [command]
    again = tl.fold(accepted, P, V)
    assert len(accepted) > 5
    for k, (state, phase) in enumerate(live):
        other, its_phase = tl.state_of(again, k * STEP * 1e-9)
        assert np.array_equal(state, other) and phase == its_phase
