"""Options by their names and values as text: `pruning.ratio=0.3`."""

from __future__ import annotations

import difflib
import re
import types
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from inspect import getdoc
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from sacha_core.errors import OptionError
from sacha_core.train.options import TrainOptions, from_record

__all__ = ["Setting", "known_settings", "with_settings"]

YES_NO = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
NONE = "none"
FIXED = ("variant",)  # names the options, and is none


@dataclass(frozen=True)
class Setting:
    """An option that can be set by name.

    Args:
        name: dotted.
        kind: its type.
        default: of the paper's run, before any variant.
        doc: what it is.
    """

    name: str
    kind: Any
    default: Any
    doc: str

    @property
    def expected(self) -> str:
        """Say what values it takes."""
        return _expected(self.kind)


def known_settings() -> dict[str, Setting]:
    """Give every option that can be set, by its dotted name."""
    return {setting.name: setting for setting in _settings(TrainOptions(), "") if setting.name not in FIXED}


def with_settings(options: TrainOptions, settings: Sequence[str]) -> TrainOptions:
    """Give the options with some changed by name, all at once.

    Args:
        options: to begin with.
        settings: `NAME=VALUE` each. A value is written as one writes it: `0.3`, `visible`, `yes`, `none`, `1000,2000` for several numbers,
            `eyes:2,mouth:1.5` for numbers by name.

    Raises:
        OptionError: naming an option that there is not, with those of similar names, or a value that makes no sense.
    """
    known, record = known_settings(), options.record()
    for text in settings:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not sign:
            raise OptionError(f"setting {text!r} is not NAME=VALUE, such as pruning.ratio=0.3")
        if name not in known:
            raise OptionError(f"option {name!r} is unknown; {_alike(name, known)}")
        group = record
        *outer, last = name.split(".")
        for part in outer:
            group = group[part]
        try:
            group[last] = _parsed(known[name].kind, value)
        except ValueError:
            raise OptionError(f"{name} is {value!r}, expected {known[name].expected}") from None
    return from_record(record)


def _settings(options: Any, prefix: str) -> list[Setting]:
    hints, docs = get_type_hints(type(options)), _docs(type(options))
    found = []
    for field in fields(options):
        value, name = getattr(options, field.name), prefix + field.name
        if is_dataclass(value):
            found += _settings(value, f"{name}.")
        else:
            found.append(Setting(name, hints[field.name], value, docs.get(field.name, "")))
    return found


def _docs(kind: type[Any]) -> dict[str, str]:
    """Give the text of each argument of a docstring, on one line."""
    _, _, text = (getdoc(kind) or "").partition("Args:\n")
    block = re.split(r"\n\S", text)[0]
    entries = re.findall(r"^    (\w+): (.*?)(?=^    \w|\Z)", block + "\n", re.MULTILINE | re.DOTALL)
    return {name: " ".join(said.split()) for name, said in entries}


def _alike(name: str, known: dict[str, Setting]) -> str:
    """Say which options have names like this one."""
    ends = {full.rpartition(".")[2]: full for full in reversed(known)}
    close = [full for full in known if full.rpartition(".")[2] == name.rpartition(".")[2]]
    close += difflib.get_close_matches(name, known, 3)
    close += [ends[end] for end in difflib.get_close_matches(name.rpartition(".")[2], ends, 3)]
    close = list(dict.fromkeys(close))[:4]
    return f"did you mean {', '.join(close)}?" if close else "sacha train --list-options tells all"


def _parsed(kind: Any, text: str) -> Any:
    """Give a value of a type; raises ValueError where the text is none."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in {Union, types.UnionType}:
        (inner,) = (one for one in arguments if one is not type(None))
        return None if text.lower() == NONE else _parsed(inner, text)
    if origin is Literal:
        if text not in arguments:
            raise ValueError
        return text
    if origin is tuple:
        parts = [part.strip() for part in text.strip("()[]").split(",") if part.strip()]
        return [_parsed(arguments[0], part) for part in parts] if arguments[-1] is Ellipsis else _pair(arguments, text)
    if kind is bool:
        if text.lower() not in YES_NO:
            raise ValueError
        return YES_NO[text.lower()]
    return kind(text)


def _pair(kinds: tuple[Any, ...], text: str) -> list[Any]:
    parts = text.split(":")
    if len(parts) != len(kinds):
        raise ValueError
    return [_parsed(kind, part.strip()) for kind, part in zip(kinds, parts, strict=True)]


def _expected(kind: Any) -> str:
    """Say what a type's values look like."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in {Union, types.UnionType}:
        (inner,) = (one for one in arguments if one is not type(None))
        return f"{_expected(inner)}, or none"
    if origin is Literal:
        return f"one of {', '.join(arguments)}"
    if origin is tuple:
        if get_origin(arguments[0]) is tuple:
            return "NAME:NUMBER,NAME:NUMBER,..."
        return "whole numbers with commas between"
    return {bool: "yes or no", int: "a whole number", float: "a number", str: "a word"}[kind]
