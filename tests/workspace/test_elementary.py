"""What is flown uses no function of the C library that differs between machines."""

import ast
from pathlib import Path

import pytest

SRC = Path(__file__).parents[2] / 'src'
PACKAGES = ('mambo_model', 'mambo_sim', 'mambo_estimation', 'mambo_control')
FOREIGN = {
    'sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'atan2', 'sinh', 'cosh', 'tanh', 'exp', 'exp2',
    'expm1', 'log', 'log2', 'log10', 'log1p', 'pow', 'cbrt', 'hypot', 'arcsin', 'arccos', 'arctan',
    'arctan2', 'power', 'float_power', 'standard_normal', 'normal'}
# Which files may, and why.
EXCEPTIONS = {
    'mambo_model/arithmetic/trigonometry.py': 'angles beyond 6e9 rad',
    'mambo_model/arithmetic/double_double.py': 'powers of exact decimal numbers',
    'mambo_model/arithmetic/exponential.py': 'powers of exact decimal numbers',
    'mambo_estimation/capture/report.py': 'diagnostics are text of few digits',
    'mambo_control/literature/predictive.py': 'a solver of others, which is not bit for bit',
}
MODULES = [path for name in PACKAGES for path in sorted((SRC / name / name).rglob('*.py'))]


def calls(tree):
    """Yield foreign functions, and powers that are not of whole constants."""
    for node in ast.walk(tree):
        if (isinstance(node, ast.Attribute) and node.attr in FOREIGN
                and isinstance(node.value, ast.Name)
                and node.value.id in ('math', 'np', 'rng', 'numpy')):
            yield f'{node.value.id}.{node.attr}'
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and not (
                isinstance(node.left, ast.Constant) and isinstance(node.right, (
                    ast.Constant, ast.UnaryOp))):
            yield f'{ast.unparse(node)}'


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(SRC)))
def test_only_the_functions_of_arithmetic_are_called(path):
    name = str(path.relative_to(SRC / path.relative_to(SRC).parts[0]))
    if name in EXCEPTIONS:
        return
    found = list(calls(ast.parse(path.read_text())))
    assert not found, f'{name}: take them from mambo_model.arithmetic: {found}'


@pytest.mark.parametrize('text', ['math.sin(x)', 'np.exp(x)', 'x ** y', 'x ** 2', 'rng.normal()'])
def test_a_foreign_function_is_found(text):
    assert list(calls(ast.parse(text)))
    assert not list(calls(ast.parse('sin(x) * math.sqrt(x) * 2 ** 31 * 2.0 ** -53')))
