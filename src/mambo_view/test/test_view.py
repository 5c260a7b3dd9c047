"""The command plays a bag, over and over, at the chosen speed."""

from pathlib import Path
import shutil

from free_port import free_port
from mambo_bags.writer import BagWriter
from mambo_ros import messages
from mambo_view import view, view_node
from mambo_view.drone_state import MEASURED, TRUTH
import pytest

BAG = Path(__file__).parents[3] / 'bags/circle_short'


@pytest.fixture
def player():
    one = view.Player([BAG], free_port())
    yield one
    one.page.close()


def test_it_advances_with_the_wall_clock_times_the_speed_and_begins_again(player):
    player.step(0.1)
    assert player._slider.value == pytest.approx(0.1)
    player._speed.value = '5'
    player.step(0.1)
    assert player._slider.value == pytest.approx(0.6)
    player.step(100.0)  # the machine slept
    assert player._slider.value == pytest.approx(1.6)
    player._slider.value = 7.9
    player.step(0.1)
    assert player._slider.value == 0.0


def test_a_paused_one_shows_what_the_slider_says(player):
    player._play.value = False
    player._slider.value = 5.0
    player.step(0.1)
    assert player._slider.value == 5.0
    frame = player.page._drones[0]._frames[TRUTH]
    expected = player._recordings[0].state(player.start + 5.0).position(TRUTH)
    assert frame.visible and tuple(frame.position) == expected
    assert 't = 5.00 s of 8.00 s' in player.page._status.content
    assert len(player.page._plot.data[0]) == 1500


def test_it_plays_until_it_is_told_to_stop(player):
    left = [1, 1, 1]
    player.play(lambda: bool(left and left.pop()))
    assert not left and player._slider.value > 0.05


def test_several_bags_are_several_drones(tmp_path):
    shutil.copytree(BAG, tmp_path / 'other')
    player = view.Player([BAG, tmp_path / 'other'], free_port())
    player.step(0.05)
    assert [drone._frames[TRUTH].visible for drone in player.page._drones] == [True, True]
    player.page.close()


def test_of_a_bag_with_several_drones_one_is_chosen(tmp_path, capsys):
    writer = BagWriter(tmp_path / 'both')
    heights = {'/a/optitrack/pose': 1.0, '/b/optitrack/pose': 2.0}
    for name in heights:
        writer.add_topic(name, 'geometry_msgs/msg/PoseStamped')
    for name, height in heights.items():
        writer.write(name, messages.optitrack(0, (0.0, 0.0, -height), (1.0, 0.0, 0.0, 0.0)), 0)
    writer.close()
    path = tmp_path / 'both'
    assert view.main([str(path)]) == 2
    assert '/a, /b; choose one (namespace=..., on the command line --namespace)' in (
        capsys.readouterr().err)
    player = view.Player([path], free_port(), 'b')
    assert player._recordings[0].state(0.0).position(MEASURED)[2] == 2.0
    player.page.close()


def test_wrong_input_is_one_line_and_ctrl_c_the_way_out(capsys, monkeypatch, tmp_path):
    for words in (['--port', '0'], [str(tmp_path / 'none')], ['--port', 'x'],
                  ['--namespace', 'b'], [str(BAG), '--namespace', 'b'],
                  [str(BAG), '--drones', '/x'], [str(BAG), '--no-commands']):
        try:
            code = view.main(words)
        except SystemExit as end:
            code = end.code
        said = capsys.readouterr().err
        assert code == 2 and said.count('\n') == 1, said

    def interrupted(self, going=None):
        raise KeyboardInterrupt
    monkeypatch.setattr(view.Player, 'play', interrupted)
    assert view.main([str(BAG), '--port', str(free_port())]) == 0
    assert 'Ctrl-C ends it' in capsys.readouterr().out


def test_without_a_bag_it_is_the_node_of_the_running_flight(monkeypatch):
    given = []
    monkeypatch.setattr(view_node, 'main', given.append)
    port = free_port()
    assert view.main(['--port', str(port), '--drones', '/mambo1,/mambo2']) == 0
    assert given.pop() == [
        '--ros-args', '-p', f'port:={port}', '-p', 'drones:=/mambo1,/mambo2',
        '-p', 'commands:=true', '-p', 'trajectories:=".,examples"']
    assert view.main(['--port', str(port), '--no-commands', '--trajectories', 'mine']) == 0
    assert given.pop()[-3:] == ['commands:=false', '-p', 'trajectories:="mine"']
