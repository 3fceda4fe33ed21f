"""What the sliders of the explorer say, and where they go."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Conditions(NamedTuple):
    """A display, and how the picture moves on it. Plain numbers.

    - `velocity` [deg/s], `refresh_rate` [Hz], `persistence` (0, 1], `ppd` [px/deg] and
      `luminance` [cd/m^2], as in `camojab.Display` and `camojab.Viewing`.
    """

    velocity: float = 15.0
    refresh_rate: float = 60.0
    persistence: float = 1.0
    ppd: float = 60.0
    luminance: float = 100.0

    def array(self) -> Float[np.ndarray, "5"]:
        """The fields in their order: what is traced, so that nothing compiles anew."""
        return np.array(self, np.float32)


RANGES: dict[str, tuple[float, float]] = {
    "velocity": (0.0, 60.0),
    "refresh_rate": (24.0, 240.0),
    "persistence": (0.01, 1.0),
    "ppd": (10.0, 120.0),
    "luminance": (0.1, 1000.0),
}
"""Ends of the sliders, in the units of `Conditions`."""
