"""What balances a metric's values before they are learned, and its exact inverse."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check


class AbstractTransform(eqx.Module, strict=True):
    """Maps a metric to [0, 1], where 0 is no error, and back.

    A transform computes in the precision of what it is given.
    """

    @abstractmethod
    def __call__(self, metric: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The transformed metric. [1], in [0, 1]"""

    @abstractmethod
    def inverse(self, transformed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The metric, in its own unit, of values in [0, 1]."""

    @abstractmethod
    def at_mean(self, mean: ArrayLike) -> "AbstractTransform":
        """The same transform centred on another mean of the metric."""


class ClampedTransform(AbstractTransform, strict=True):
    r"""Scaled so that the mean is in the middle, and clamped.

    $$T(y) = \max(\min(a y + b, 1), 0)$$

    With $a = 1/(2\mu)$ and $b = 0$ it is Eq. 4, which is `from_mean`. A metric that is
    better when larger has $a < 0$ and $b > 0$: for PSNR in dB the released networks
    have $a = -0.015$ and $b = 1$. The other released ones have $b = 0$ and $a = 2$ for
    FLIP, 0.25 for its Weber-corrected form, 0.7 for that of Yang and 1 for LPIPS.

    **Arguments:**

    - `factor`: a. [1/unit of the metric], not 0.
    - `offset`: b. [1]

    **Raises:** `ValueError` for a factor of 0, or a number that is not finite.

    **Accuracy:** what is clamped cannot be had back: `inverse` undoes `__call__` only
    where a y + b is in [0, 1], and there but for rounding.

    **Source:** Cardoso et al. 2022, Section 3.3.1.
    """

    factor: Float[Array, ""]
    offset: Float[Array, ""]

    def __init__(self, factor: ArrayLike, offset: ArrayLike = 0.0):
        usable = lambda x: jnp.isfinite(x) & (x != 0)
        self.factor = check("factor", factor, usable, "finite and not 0")
        self.offset = check("offset", offset, jnp.isfinite, "finite")

    @classmethod
    def from_mean(cls, mean: ArrayLike) -> "ClampedTransform":
        """Eq. 4.

        **Arguments:** `mean`: of the metric over all data, which `Samples.mean` is.
        [unit of the metric], > 0.

        **Raises:** `ValueError` for a mean that is not positive.
        """
        return cls(1.0 / (2.0 * _positive_mean(mean)))

    def __call__(self, metric: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """See `AbstractTransform`."""
        factor, offset = _like(metric, self.factor, self.offset)
        return jnp.clip(metric * factor + offset, 0.0, 1.0)

    def inverse(self, transformed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """See `AbstractTransform`."""
        factor, offset = _like(transformed, self.factor, self.offset)
        return (transformed - offset) / factor

    def at_mean(self, mean: ArrayLike) -> "ClampedTransform":
        """With the factor that takes `mean` to one half; the offset stays.

        **Raises:** `ValueError` for a mean that is not positive, or an offset of 1/2.
        """
        offset, mean = _like(self.factor, self.offset, _positive_mean(mean))
        return ClampedTransform((0.5 - offset) / mean, self.offset)


class LogisticTransform(AbstractTransform, strict=True):
    r"""The logistic function about the mean, stretched to [0, 1].

    $$S(y) = 1/(1 + e^{-k (y - \mu)}), \quad T(y) = (S(y) - S(0))/(S(1) - S(0))$$

    It is for metrics in [0, 1]; a larger value is taken to a little more than 1.

    **Arguments:**

    - `mean`: $\mu$, of the metric over all data. [unit of the metric], in [0, 1].
    - `growth`: k. [1/unit of the metric], in (0, 80]: beyond, S(1) is 1 in float32.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Accuracy:** the inverse is exact in [0, 1]; in float32 it is within
    1e-6 (1 + e^{k max(mean, 1 - mean)}/k) of the metric: 2e-4 for k = 10, mean 0.25.

    **Source:** Cardoso et al. 2022, Eq. 5 and 6, with k = 10.
    """

    mean: Float[Array, ""]
    growth: Float[Array, ""]

    def __init__(self, mean: ArrayLike, growth: ArrayLike = 10.0):
        within = lambda x: (x >= 0) & (x <= 1)
        self.mean = check("mean", mean, within, "in [0, 1]")
        self.growth = check(
            "growth", growth, lambda k: (k > 0) & (k <= 80), "in (0, 80]"
        )

    def __call__(self, metric: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """See `AbstractTransform`."""
        mean, growth = _like(metric, self.mean, self.growth)
        low, high, _ = _ends(mean, growth)
        return (jax.nn.sigmoid(growth * (metric - mean)) - low) / (high - low)

    def inverse(self, transformed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """See `AbstractTransform`."""
        mean, growth = _like(transformed, self.mean, self.growth)
        low, high, rest = _ends(mean, growth)
        inside = low + transformed * (high - low)
        # 1 - S would cancel where S is near 1.
        outside = rest + (1.0 - transformed) * (high - low)
        return mean + (jnp.log(inside) - jnp.log(outside)) / growth

    def at_mean(self, mean: ArrayLike) -> "LogisticTransform":
        """See `AbstractTransform`."""
        (mean,) = _like(self.mean, jnp.asarray(mean))
        return LogisticTransform(mean, self.growth)


def _ends(mean: Array, growth: Array) -> tuple[Array, Array, Array]:
    """S(0), S(1) and 1 - S(1)."""
    far = growth * (1.0 - mean)
    low = jax.nn.sigmoid(-growth * mean)
    return low, jax.nn.sigmoid(far), jax.nn.sigmoid(-far)


def _like(values: Array, *constants: Array) -> tuple[Array, ...]:
    return tuple(jnp.asarray(c).astype(values.dtype) for c in constants)


def _positive_mean(mean: ArrayLike) -> Array:
    finite = lambda x: (x > 0) & (x < np.inf)
    return check("mean", mean, finite, "> 0 and finite")
