"""The nodes of a hall: files of halls that they refuse."""

from mambo_bringup import composed_node, hall_capture_node
import pytest


@pytest.mark.parametrize('program, main', [
    ('composed_node', composed_node.main), ('hall_capture_node', hall_capture_node.main)])
@pytest.mark.parametrize('text, message', [
    (None, 'No such file or directory'), ('x: 1', 'must hold world and places'),
    ('world: {drones: 2}\nplaces: {}', '0 places, but drones = 2')])
def test_a_file_without_a_hall_is_refused_in_one_line(
        tmp_path, capsys, text, message, program, main):
    file = tmp_path / 'world.yaml'
    if text is not None:
        file.write_text(text)
    with pytest.raises(SystemExit) as end:
        main(['--world', str(file)])
    error = capsys.readouterr().err
    assert end.value.code == 2 and error.startswith(f'{program}: --world: {file}: ')
    assert message in error and error.count('\n') == 1
