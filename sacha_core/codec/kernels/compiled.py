"""The loops of `arithmetic` compiled: each function in turn, so that those that call it find the compiled one."""

from __future__ import annotations

import types

from sacha_core.codec.kernels import arithmetic
from sacha_core.parallel.kernels.kernel import kernel

ORDER = (
    "activity", "adapt", "split", "shift_low", "next_byte", "encode_bit", "encode_even", "decode_bit", "decode_even",
    "encode_integers", "decode_integers",
)  # fmt: skip


def compile_all():
    """Compile every function of `arithmetic` over a copy of its names, leaving the plain ones as they are."""
    names = dict(vars(arithmetic))
    for name in ORDER:
        plain = getattr(arithmetic, name)
        names[name] = kernel(types.FunctionType(plain.__code__, names, name))
    return names


_compiled = compile_all()
encode_integers = _compiled["encode_integers"]
decode_integers = _compiled["decode_integers"]
