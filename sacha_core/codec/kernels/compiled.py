"""The loops of `arithmetic`, `residuals` and `frames` compiled: each function in turn, so that those that call it find the compiled one."""

from __future__ import annotations

import types

from sacha_core.codec.kernels import arithmetic, frames, residuals
from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["choose_group", "decode_group", "decode_integers", "encode_integers", "encode_residuals"]

ORDER = {
    arithmetic: (
        "activity", "adapt", "split", "shift_low", "next_byte", "encode_bit", "encode_even", "decode_bit", "decode_even",
        "encode_integers", "decode_integers",
    ),
    residuals: (
        "lowest_bits", "learn", "part_of_zero", "put_bin", "take_bin", "encode_residuals", "take_residual",
    ),
    frames: (
        "usual_size", "class_of", "forecast", "from_partners", "class_in_frame", "begin", "end_parameter",
        "decode_group", "choose_group",
    ),
}  # fmt: skip


def compile_all():
    """Compile every function over a copy of its module's names, leaving the plain ones as they are."""
    made = {}
    for module, order in ORDER.items():
        names = {**vars(module), **made}
        for name in order:
            plain = getattr(module, name)
            names[name] = made[name] = kernel(types.FunctionType(plain.__code__, names, name))
    return made


_compiled = compile_all()
encode_integers = _compiled["encode_integers"]
decode_integers = _compiled["decode_integers"]
encode_residuals = _compiled["encode_residuals"]
decode_group = _compiled["decode_group"]
choose_group = _compiled["choose_group"]
