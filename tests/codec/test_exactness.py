"""Decoding gives the same bits on every machine: it calls no function whose last bit is a platform's own, in no place that runs.

Oracle: decoding with such functions off by a few units in the last place from before the first import on, and decoding without them.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType

import pytest
from golden_streams import STREAMS, digests_of

import sacha_core
from sacha_core.codec import decode

PACKAGE = Path(sacha_core.__file__).parent
# IEEE 754 defines + - * / and the root to the last bit; the rest is left to whoever wrote the platform's library
INEXACT = (
    "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "logaddexp", "pow", "power", "float_power", "cbrt", "hypot", "sin",
    "cos", "tan", "asin", "acos", "atan", "atan2", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "arcsinh",
    "arccosh", "arctanh", "sinc", "interp", "gamma", "lgamma", "erf",
)  # fmt: skip
# sums of products in an order, and with fused operations, that is a library's own
UNORDERED = (
    "dot", "vdot", "inner", "matmul", "einsum", "tensordot", "convolve", "norm", "inv", "solve", "lstsq", "svd", "pinv", "eigh", "fma",
)  # fmt: skip
# functions whose products and sums are of integers below 2^53: exact in any order, fused or not
EXACT_ANYHOW = {("codec/harmonics.py", "coefficients")}
PROGRAM = """
    import functools, json, math, sys
    import numpy as np
    MODE, INEXACT, UNORDERED, FOLDER, FILES = json.loads(sys.argv[1])
    sys.path.insert(0, FOLDER)

    def off(name, function):
        @functools.wraps(function, updated=())
        def wrapped(*arguments, **options):
            if MODE == "removed":
                raise AssertionError(f"{name} was called")
            result = function(*arguments, **options)
            for _ in range(3):
                if isinstance(result, (float, np.ndarray, np.floating)) and np.asarray(result).dtype.kind == "f":
                    result = np.nextafter(result, np.inf).astype(np.asarray(result).dtype)[()]
            return float(result) if isinstance(function(*arguments, **options), float) else result
        return wrapped

    def spoil():
        for home in (math, np, np.linalg):
            for name in INEXACT + UNORDERED:
                if callable(getattr(home, name, None)):
                    setattr(home, name, off(f"{home.__name__}.{name}", getattr(home, name)))

    if MODE == "off":
        spoil()
    assert MODE != "off" or math.exp(1.0) != 2.718281828459045
    from golden_streams import digests_of
    if MODE == "removed":
        spoil()
    print(json.dumps({name: digests_of(open(file, "rb").read()) for name, file in FILES.items()}))
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("streams")
    made = {}
    for name, make in STREAMS.items():
        made[name] = folder / f"{name}.sacha"
        made[name].write_bytes(make())
    return made


@pytest.mark.parametrize("mode", ["off", "removed"])
def test_arrays_are_the_same_with_other_functions(files, mode):
    told = json.dumps(
        [mode, INEXACT, UNORDERED, str(Path(__file__).parent), {name: str(file) for name, file in files.items()}]
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", textwrap.dedent(PROGRAM), told],
        capture_output=True,
        text=True,
        check=False,
        cwd=PACKAGE.parent,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert json.loads(done.stdout) == {name: digests_of(file.read_bytes()) for name, file in files.items()}


def functions_that_run(files: dict[str, Path]) -> set[CodeType]:
    """Give the code of every function of this package that decoding enters."""
    entered: set[CodeType] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(str(PACKAGE)):
            entered.add(frame.f_code)

    sys.setprofile(note)
    try:
        for file in files.values():
            decode(file)
    finally:
        sys.setprofile(None)
    return entered


def place_of(code: CodeType) -> str:
    """Give the file of a function, within the package."""
    return Path(code.co_filename).relative_to(PACKAGE).as_posix()


def inexact_in(code: CodeType) -> Iterator[str]:
    """Name what a function's source has that could differ between machines."""
    source = Path(code.co_filename)
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and node.lineno <= code.co_firstlineno <= (node.body[0].lineno):
            for inner in ast.walk(node):
                place = f"{source.relative_to(PACKAGE)}:{getattr(inner, 'lineno', '?')}"
                if isinstance(inner, ast.BinOp) and isinstance(inner.op, ast.MatMult):
                    yield f"{place} @"
                if isinstance(inner, ast.BinOp) and isinstance(inner.op, ast.Pow) and not is_whole(inner.right):
                    yield f"{place} **"
                if isinstance(inner, ast.Attribute) and inner.attr in INEXACT + UNORDERED and names_a_library(inner):
                    yield f"{place} {inner.attr}"


def is_whole(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int)


def names_a_library(node: ast.Attribute) -> bool:
    return ast.unparse(node.value) in {"np", "math", "np.linalg", "numpy"}


def test_no_function_that_runs_has_such_a_call_or_operator(files):
    """Operators cannot be replaced as functions can: @ and ** are looked for in the source of what ran."""
    entered = {code for code in functions_that_run(files) if (place_of(code), code.co_name) not in EXACT_ANYHOW}
    assert any(code.co_name == "decode_points" for code in entered)
    assert any(code.co_name == "decode_exactly" for code in entered)
    assert sorted({one for code in entered for one in inexact_in(code)}) == []
