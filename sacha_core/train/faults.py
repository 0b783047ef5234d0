"""Steps that were not taken, because a number in them was not finite."""

from __future__ import annotations

from dataclasses import dataclass

from sacha_core.avatar.motion import DYNAMIC_WIDTHS

__all__ = ["CAUSES", "LARGEST_GRADIENT", "Fault", "Faults"]

# attributes in the order in which one spoils the next: a colour's gradient reaches the mean through the direction of view
CAUSES = ("sh_dc", "sh_rest", "sensitivity_logit", "opacity_logit", "log_scale", "quaternion", "position")

LARGEST_GRADIENT = (
    1e18  # from a little above, its square, which Adam keeps, is no float32 number; such a step is not taken either
)
BY_TIMESTEP = {"expression", *DYNAMIC_WIDTHS}


@dataclass(frozen=True)
class Fault:
    """Why a step was not taken.

    Args:
        iteration: which one, counted from 1.
        parameter: whose gradient was not finite; or `colour`, `loss` or `pose`, where it did not come so far.
        row: the first Gaussian for attributes and `colour`, the timestep for everything else.
    """

    iteration: int
    parameter: str
    row: int

    def __str__(self) -> str:
        if self.parameter == "pose":
            return f"the pose of timestep {self.row} left a triangle without area"
        if self.parameter == "loss":
            return f"loss of a view of timestep {self.row} was not finite"
        if self.parameter == "colour":
            return f"colour of Gaussian {self.row} was not finite, or too large for float32"
        owner = "timestep" if self.parameter in BY_TIMESTEP else "Gaussian"
        return f"gradient of {self.parameter} of {owner} {self.row} was not finite, or too large for float32"


@dataclass(frozen=True)
class Faults:
    """All faults of a run.

    Args:
        count: of steps that were not taken.
        first: the first of them; None where there is none.
    """

    count: int = 0
    first: Fault | None = None

    def and_one(self, fault: Fault) -> Faults:
        """Give these and one more."""
        return Faults(self.count + 1, self.first or fault)

    def __str__(self) -> str:
        if self.first is None:
            return "no step was skipped"
        steps = "1 step was skipped," if self.count == 1 else f"{self.count:,} steps were skipped, the first"
        return f"{steps} at iteration {self.first.iteration}: {self.first}"
