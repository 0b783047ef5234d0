"""Options of the variants that are compared, as someone names them on a command line."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from sacha_core.errors import OptionError
from sacha_core.train.checkpoint import flat
from sacha_core.train.options import TrainOptions, from_record
from sacha_core.train.presets import scaled

__all__ = ["variant_options"]

EXPECTED = {bool: "true or false", int: "a whole number", float: "a number", str: "a word", tuple: "a list"}


def variant_options(
    names: Sequence[str], iterations: int, settings: Sequence[str] = (), base: TrainOptions | None = None
) -> dict[str, TrainOptions]:
    """Give the options of each variant by the name that results shall call it.

    Args:
        names: of `presets.VARIANTS`, or NEW=VARIANT for a variant of which settings are changed under another name.
        iterations: length of each run.
        settings: changes, `OPTION=VALUE` for all variants or `NAME:OPTION=VALUE` for one; an option is named as `options.json` nests it
            ("pruning.ratio"), a value is JSON or a word.
        base: what variants do not decide; the defaults by default.

    Raises:
        OptionError: naming the variant, setting or value that makes no sense.
    """
    chosen: dict[str, TrainOptions] = {}
    for given in names:
        name, _, of = given.partition("=")
        if name in chosen:
            raise OptionError(f"variant {name!r} is there twice")
        chosen[name] = scaled(iterations, of or name, base)
    for setting in settings:
        whom, option, value = _parsed(setting)
        if whom is not None and whom not in chosen:
            raise OptionError(f"{setting!r} sets an option of {whom!r}; expected one of {', '.join(chosen)}")
        for name in chosen if whom is None else (whom,):
            chosen[name] = _changed(chosen[name], option, value)
    return chosen


def _parsed(setting: str) -> tuple[str | None, str, Any]:
    """Take a setting apart: whose, which option, what."""
    left, sign, text = setting.partition("=")
    whom, colon, option = left.rpartition(":")
    if not sign or not option:
        raise OptionError(f"setting {setting!r} is not OPTION=VALUE or VARIANT:OPTION=VALUE")
    try:
        value = json.loads(text)
    except ValueError:
        value = text
    return whom if colon else None, option, value


def _changed(options: TrainOptions, option: str, value: Any) -> TrainOptions:
    """Give options with one changed, by its dotted name."""
    record = options.record()
    known = flat(record)
    if option not in known or option in {"variant", "seed"}:
        raise OptionError(
            f"option {option!r} is unknown; expected one of {', '.join(sorted(set(known) - {'variant', 'seed'}))}"
        )
    group: dict[str, Any] = record
    *outer, last = option.split(".")
    for name in outer:
        group = group[name]
    group[last] = _typed(option, value, known[option])
    return from_record(record)


def _typed(option: str, value: Any, present: Any) -> Any:
    """Give a value in the type of the one that is there; None stands for a whole number that is not given."""
    if present is None or value is None:
        good = (
            isinstance(value, int | None)
            and not isinstance(value, bool)
            and (present is None or isinstance(present, int))
        )
        kind: type = int
    else:
        kind = type(present)
        good = isinstance(value, list if kind is tuple else (int, float) if kind is float else kind)
        good = good and isinstance(value, bool) == (kind is bool)
    if not good:
        raise OptionError(f"{option} is set to {json.dumps(value)}, expected {EXPECTED[kind]}")
    return float(value) if kind is float else tuple(value) if kind is tuple else value
