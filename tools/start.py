"""Start a command of the project: the Python part of ``tools/start``."""

import os
import sys

# neither this folder nor, as with ``python3 -m``, the user's own: a file numpy.py there is theirs
here = os.path.dirname(os.path.realpath(__file__))
sys.path[:] = [path for path in sys.path if os.path.realpath(path) != here]

if __name__ == '__main__':
    try:
        from mambo_bringup.starting import run
    except ModuleNotFoundError as error:
        if error.name != 'mambo_bringup':
            raise
        sys.exit(f'{sys.argv[1]}: PYTHONPATH lacks the packages of this workspace: it was set '
                 "after 'source env.bash'. Source it again, and set PYTHONPATH=FOLDER:$PYTHONPATH")
    sys.exit(run(sys.argv.pop(1)))
