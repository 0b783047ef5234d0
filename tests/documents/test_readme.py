"""The README's promises, executed: its example in Python, its commands by name, its links."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sacha_core.cli import main
from sacha_core.cli.commands import COMMANDS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_python_examples_run(capsys):
    example, streaming = blocks("python")
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["picture"].shape == (401, 275, 3)
    assert names["picture"].min() < 0.9, "something is drawn"
    assert names["counts"].sum() == names["head"].n_faces
    assert f"{len(names['stream'])} bytes" in capsys.readouterr().out
    exec(compile(streaming, "README.md", "exec"), names)
    told = capsys.readouterr().out.split("\n")
    assert [line.split()[0] for line in told if line] == ["avatar", "frames", "frames", "0"]


@pytest.mark.parametrize(
    "line", [line for block in blocks("sh") for line in block.splitlines() if line.startswith("sacha ")]
)
def test_commands_and_their_options_exist(line, capsys):
    """Each command's own help knows every option that the README uses."""
    words = line.split("#")[0].split()
    assert words[1] in COMMANDS
    assert main([words[1], "--help"]) == 0
    shown = capsys.readouterr().out
    for word in words[2:]:
        if word.startswith("-"):
            assert word in shown, f"`sacha {words[1]}` has no option {word}"


def test_make_targets_exist():
    makefile = (ROOT / "Makefile").read_text() + "".join(path.read_text() for path in ROOT.glob("tools/*.mk"))
    for target in re.findall(r"\bmake (\w+)", README):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), f"no target {target}"


def test_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), f"README links to {target}, which is not there"
