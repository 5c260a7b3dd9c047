"""What the tests of the commands for courses share."""

from pathlib import Path

EIGHT = str(Path(__file__).parents[3] / 'examples/figure_eight.csv')
FAST = 't,x,y,height\n0,0,0,1.5\n1.4,6,0,1.5\n2.8,0,0,1.5\n'


def lines(capsys):
    """Return the lines of standard output and of standard error."""
    out, err = capsys.readouterr()
    return out.splitlines(), err.splitlines()
