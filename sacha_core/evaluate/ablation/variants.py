"""Options of the variants that are compared, as someone names them on a command line."""

from __future__ import annotations

from collections.abc import Sequence

from sacha_core.errors import OptionError
from sacha_core.train.options import TrainOptions
from sacha_core.train.presets import scaled
from sacha_core.train.settings import with_settings

__all__ = ["variant_options"]


def variant_options(
    names: Sequence[str], iterations: int, settings: Sequence[str] = (), base: TrainOptions | None = None
) -> dict[str, TrainOptions]:
    """Give the options of each variant by the name that results shall call it.

    Args:
        names: of `presets.VARIANTS`, or NEW=VARIANT for a variant of which settings are changed under another name.
        iterations: length of each run.
        settings: changes, `OPTION=VALUE` for all variants or `NAME:OPTION=VALUE` for one (see `with_settings`).
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
    changes: dict[str, list[str]] = {name: [] for name in chosen}
    for setting in settings:
        whose, change = _addressed(setting)
        if whose is not None and whose not in chosen:
            raise OptionError(f"setting {setting!r} is for variant {whose!r}; expected one of {', '.join(chosen)}")
        for name in chosen if whose is None else (whose,):
            changes[name].append(change)
    return {name: with_settings(options, changes[name]) for name, options in chosen.items()}


def _addressed(setting: str) -> tuple[str | None, str]:
    """Take the variant's name, if any, from a setting."""
    left, sign, value = setting.partition("=")
    whose, colon, option = left.rpartition(":")
    if option.strip() == "seed":
        raise OptionError("seeds are not set one by one; --seeds says how many")
    return whose if colon else None, f"{option}{sign}{value}"
