"""Nodes along a frequency axis, and the weights that carry energies over to them.

The filters and sensitivities that multiply a spectrum are smooth functions of log
frequency. Interpolated between Chebyshev nodes of it, they turn a sum over thousands of
bins into one over a few dozen nodes, whose error falls geometrically with their number.
"""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


# Bins added before the logarithm is taken: sensitivities fall exponentially with
# frequency, and a plain logarithm would take nodes from where they do.
_OFFSET = 16.0


@dataclass(frozen=True)
class Axis:
    """Chebyshev nodes between the lowest and the highest frequency met. [bins]."""

    lowest: float
    highest: float

    def nodes(self, number: int) -> Float[np.ndarray, " nodes"]:
        """Frequencies, rising. [bins]."""
        low, high = self._ends()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        return np.exp(middle + half * _roots(number)) - _OFFSET

    def weights(
        self, frequency: Float[Array, "*n"], number: int
    ) -> Float[Array, "*n nodes"]:
        """Share of each node in a function at `frequency`: Lagrange's polynomials.

        Frequencies [bins] beyond the ends count as these.

        **Source:** interpolation in Chebyshev points: Trefethen 2019, Approximation
        Theory and Approximation Practice, ch. 2 to 4.
        """
        low, high = self._ends()
        inside = jnp.clip(frequency, self.lowest, self.highest)
        x = (2.0 * jnp.log(inside + _OFFSET) - low - high) / (high - low)
        angle = jnp.arccos(jnp.clip(x, -1.0, 1.0))
        degree = np.arange(number)
        of_nodes = np.cos(degree[:, None] * np.arccos(_roots(number))) * (2.0 / number)
        of_nodes[0] *= 0.5
        degrees = jnp.asarray(degree, x.dtype).reshape((1,) * x.ndim + (number,))
        return jnp.matmul(
            jnp.cos(angle[..., None] * degrees),
            jnp.asarray(of_nodes, x.dtype),
            precision=jax.lax.Precision.HIGHEST,
        )

    def _ends(self) -> tuple[float, float]:
        return math.log(self.lowest + _OFFSET), math.log(self.highest + _OFFSET)


def _roots(number: int) -> Float[np.ndarray, " nodes"]:
    return -np.cos((2.0 * np.arange(number) + 1.0) * np.pi / (2.0 * number))
