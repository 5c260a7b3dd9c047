"""What the page about components of one's own says works, word for word."""

from pathlib import Path
import re
import shlex

from mambo_bags.reader import read_bag
from mambo_bringup import run
from mambo_flight import fly
import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs/how-to/own-component.md').read_text(encoding='utf-8')
COMMANDS = [line for block in re.findall(r'```bash\n(.*?)```', PAGE, re.DOTALL)
            for line in block.splitlines()]


@pytest.fixture
def here(tmp_path, monkeypatch):
    (tmp_path / 'examples').symlink_to(ROOT / 'examples')
    monkeypatch.chdir(tmp_path)


def test_the_page_has_commands():
    assert len(COMMANDS) == 5 and all(line.startswith('./') for line in COMMANDS)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize('command', COMMANDS)
def test_a_command_of_the_page_works(command, here, capsys):
    program, *words = shlex.split(command)
    if program == './mambo':
        assert words[0] == 'fly' and fly.main(words[1:]) == 0
        assert 'sha256' in str(read_bag(Path(words[-1]), ()).attachments['scenario.yaml'])
        return
    assert program == './run'
    if '--print-scenario' in words:
        assert run.main(words) == 0
        assert 'position_gain: 4.0' in capsys.readouterr().out
        return
    name, found, _ = run._scenario(run.parser().parse_args(words))
    assert name.endswith('_seed1')
    if '--set' in words:
        assert found.controller_node.pd_controller.position_gain == 5.0
