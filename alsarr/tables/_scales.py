"""Scales of motion on which quality is closer to a polynomial than in deg/s.

What was left of each: `tests/benchmarks/bench_tables.py`.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


# Below about this velocity quality changes in steps. [deg/s].
_SLOW = 0.5

TRAVEL = 0.05
"""Travel in one frame from which on `log_travel` is a logarithm. [deg]."""


def log_travel(velocity: Array, refresh_rate: Array) -> Array:
    """ln(1 + (v/f) / 0.05 deg), of the travel in one frame. [1].

    The width of hold-type blur is the travel times the persistence.

    **Arguments:** [deg/s], >= 0, and [Hz], > 0.
    """
    return jnp.log1p(velocity / (TRAVEL * refresh_rate))


def log_travel_beyond(shortest: float, velocity: Array, refresh_rate: Array) -> Array:
    """ln(v/f) of the travel in one frame, no less than the `shortest`. [ln(deg)].

    The temporal replica lies at f/(2 v) cycles/deg and comes into what the display can
    show once the travel is half a pixel: there the quality has a kink, and below it
    hardly changes.

    **Arguments:** [deg] > 0, [deg/s] >= 0, and [Hz] > 0.
    """
    return jnp.log(jnp.maximum(velocity / refresh_rate, shortest))


def even_velocities(ends: tuple[float, float], share: np.ndarray) -> np.ndarray:
    """Velocities at shares of the way between two, on a scale of ln(0.5 deg/s + v)."""
    low, high = np.log(_SLOW + np.asarray(ends))
    return np.exp(low + share * (high - low)) - _SLOW
