"""The shell command `sacha`: one file for each subcommand.

A command is a module with a frozen dataclass `Options`, whose docstring is its help, and `run(options, console)`, which does the work and
returns what `--json` shall hold. It imports what is heavy inside `run`; `INPUTS` names the options whose files must be there, so that a
wrong name is told before that. Adding one: write the module, name it in `commands.COMMANDS`.
"""

from __future__ import annotations

from sacha_core.cli.program import main

__all__ = ["main"]
