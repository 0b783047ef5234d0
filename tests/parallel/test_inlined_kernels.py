"""Kernels that others call become part of them, wherever rounding is left to the compiler.

The oracle is the source text: what calls what, and with which options it is compiled.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import sacha_core

KERNELS = sorted(Path(sacha_core.__file__).parent.rglob("kernels/*.py"))


def kernels_of(path):
    """Give every kernel that a file defines, with the options of its decorator."""
    found = {}
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            for decorator in node.decorator_list:
                call = decorator.func if isinstance(decorator, ast.Call) else decorator
                if ast.unparse(call) == "kernel":
                    keywords = decorator.keywords if isinstance(decorator, ast.Call) else []
                    found[node.name] = (node, {word.arg: ast.unparse(word.value) for word in keywords})
    return found


def imported_into(path):
    """Give the names that a file imports from other kernel files, each with the file."""
    names = {}
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and ".kernels." in node.module:
            source = Path(sacha_core.__file__).parent.parent.joinpath(*node.module.split(".")).with_suffix(".py")
            names.update({alias.asname or alias.name: (source, alias.name) for alias in node.names})
    return names


def calls_between_kernels():
    """Give each call of one kernel by another: both names, and the options of the one that is called."""
    kernels = {path: kernels_of(path) for path in KERNELS}
    found = []
    for path, own in kernels.items():
        reachable = {name: (path, name) for name in own} | imported_into(path)
        for caller, (body, _) in own.items():
            for node in ast.walk(body):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in reachable:
                    source, name = reachable[node.func.id]
                    if name in kernels.get(source, {}):
                        found.append((f"{path.stem}.{caller}", f"{source.stem}.{name}", kernels[source][name][1]))
    return sorted({(caller, called, tuple(options.items())) for caller, called, options in found})


@pytest.mark.parametrize(("caller", "called", "options"), calls_between_kernels())
def test_called_kernel_rounds_the_same_wherever_its_code_came_from(caller, called, options):
    options = dict(options)
    assert "fastmath" not in options or options.get("forceinline") == "True", (
        f"{called}, which {caller} calls, lets the compiler choose the rounding and is not inlined: its results would "
        "depend on whether it was compiled by this process or came with its caller's kept code"
    )


def test_calls_between_kernels_are_found():
    called = {called for _, called, _ in calls_between_kernels()}
    assert {"shading.noise", "settle.note_view", "frames.gather"} <= called
