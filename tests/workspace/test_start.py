"""tools/start: what a user's folder holds, or Ctrl-C in the first moment, breaks no command."""

import marshal
import os
from pathlib import Path
import signal
import subprocess
import time

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize('command', [['run', '--list-scenarios'], ['mambo', '--help']])
def test_files_of_the_user_named_like_packages_are_left_alone(tmp_path, command):
    for name in ('numpy', 'yaml', 'random', 'tqdm', 'docs'):
        (tmp_path / f'{name}.py').write_text('raise SystemExit("taken for a package")')
    environment = {name: value for name, value in os.environ.items() if name != 'PYTHONSAFEPATH'}
    done = subprocess.run([ROOT / command[0], *command[1:]], cwd=tmp_path, env=environment,
                          capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout


@pytest.mark.parametrize('given', ['PYTHONPATH=.', 'PYTHONPATH=', '-u PYTHONPATH'])
def test_a_search_path_that_was_set_after_env_bash_is_named(tmp_path, given):
    done = subprocess.run(['bash', '-c', f'env {given} {ROOT}/tools/mambo --help'], cwd=tmp_path,
                          capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr == (
        'mambo: PYTHONPATH lacks the packages of this workspace: it was set after '
        "'source env.bash'. Source it again, and set PYTHONPATH=FOLDER:$PYTHONPATH\n")


@pytest.mark.parametrize(('before', 'command'), [
    ('true', f'{ROOT}/mambo separation --help'),
    ('true', f'{ROOT}/tools/mambo separation --help'),
    ('python3 -c "import mambo_ros.entry"',
     'python3 -c "from mambo_ros.entry import mambo_sim; mambo_sim.sim_node()" --help')])
def test_a_limit_of_file_sizes_leaves_no_cut_byte_code(tmp_path, before, command):
    """Python writes what the limit allows of a module's byte code, and reads it ever after."""
    kept = {name: value for name, value in os.environ.items() if name != 'PYTHONDONTWRITEBYTECODE'}
    subprocess.run(
        ['bash', '-c', f'{before}; ulimit -f 1; {command} </dev/null'], capture_output=True,
        timeout=120, env=kept | {'PYTHONPYCACHEPREFIX': str(tmp_path), 'ROS_DOMAIN_ID': '101'})
    for path in tmp_path.rglob('*.pyc'):
        marshal.loads(path.read_bytes()[16:])  # EOFError of one that is cut off


def test_ctrl_c_before_python_has_started_is_one_line(tmp_path):
    """A slow start of Python: the interrupt comes while it looks for its customisations."""
    (tmp_path / 'sitecustomize.py').write_text(f"""
import pathlib, sys, time
if 'start.py' in str(sys.orig_argv):
    pathlib.Path({str(tmp_path / "begun")!r}).touch()
    time.sleep(1)
""")
    run = subprocess.Popen(
        [ROOT / 'mambo', 'view', ROOT / 'bags/circle_short'], start_new_session=True,
        env=os.environ | {'PYTHONPATH': f'{tmp_path}:{os.environ["PYTHONPATH"]}'},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    limit = time.monotonic() + 60
    while not (tmp_path / 'begun').exists() and time.monotonic() < limit:
        time.sleep(0.01)
    run.send_signal(signal.SIGINT)
    out, error = run.communicate(timeout=60)
    assert (run.returncode, out, error) == (130, '', 'mambo: ended by SIGINT\n')
