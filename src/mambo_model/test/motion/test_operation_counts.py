"""Table 2.1 of the thesis: what turning and multiplying cost, counted in the code that does it."""

import os
import subprocess
import sys

import pytest

COUNT = '''
from mambo_model.motion import quaternion as quat

class Number(float):
    """Counts what is done with it; a minus sign is free, as the table has it."""
    added = multiplied = 0
    def __add__(self, other):
        Number.added += 1
        return Number(float(self) + float(other))
    def __sub__(self, other):
        return self + -other
    def __neg__(self):
        return Number(-float(self))
    def __mul__(self, other):
        Number.multiplied += 1
        return Number(float(self) * float(other))
    __radd__, __rmul__ = __add__, __mul__

def numbers(*values):
    return tuple(map(Number, values))

def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

def matrix_product(A, B):
    return [[dot(row, column) for column in zip(*B)] for row in A]

def matrix_rotation(A, v):
    return [dot(row, v) for row in A]

q, v = numbers(0.8, 0.0, 0.6, 0.0), numbers(1.0, 2.0, 3.0)
R = [numbers(*row) for row in quat.to_matrix((0.8, 0.0, 0.6, 0.0))]
work = {{'matrix_product': (matrix_product, R, R), 'multiply': (quat.multiply, q, q),
        'matrix_rotation': (matrix_rotation, R, v), 'rotate': (quat.rotate, q, v)}}
function, *arguments = work['{name}']
function(*arguments)
print(Number.added, Number.multiplied)
'''


@pytest.mark.parametrize(('name', 'additions', 'multiplications'), [
    ('matrix_product', 18, 27), ('multiply', 12, 16), ('matrix_rotation', 6, 9),
    ('rotate', 12, 18)])
def test_operations_are_as_many_as_table_2_1_says(name, additions, multiplications):
    done = subprocess.run(
        [sys.executable, '-c', COUNT.format(name=name)], text=True, capture_output=True,
        check=True, env={**os.environ, 'NUMBA_DISABLE_JIT': '1'})
    assert tuple(map(int, done.stdout.split())) == (additions, multiplications)
