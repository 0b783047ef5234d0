"""Which options the CUDA engine does without."""

from __future__ import annotations

from sacha_core.errors import OptionError
from sacha_core.train.options import TrainOptions

__all__ = ["require_offered"]


def require_offered(options: TrainOptions) -> None:
    """Refuse what only the CPU engine does, on one line.

    Raises:
        OptionError: naming the option.
    """
    if options.losses.mask > 0:
        raise OptionError(
            f"losses.mask is {options.losses.mask}, expected 0 on cuda: masks are learnt on the CPU alone"
        )
    if (until := options.schedule.sensitivity_until) is not None:
        raise OptionError(
            f"schedule.sensitivity_until is {until}, expected none on cuda, where that loss counts to the end"
        )
