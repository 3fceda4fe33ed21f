"""An observer who votes as the scaling assumes people do."""

import math

import jax
import numpy as np
from jaxtyping import Array, Bool, Float


# 1 JND apart, 75 % prefer the better: 1 / Phi^-1(0.75).
SIGMA = 1.482602218505602


def preference(
    quality_a: Float[Array, "*n"], quality_b: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Probability that A is preferred to B, from their qualities [JND]. In (0, 1).

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from camojab.votes import preference
    >>> chosen = preference(jnp.array([0.0, 1.0, 2.0]), jnp.zeros(3))
    >>> print(np.asarray(chosen).round(3))
    [0.5   0.75  0.911]
    """
    return jax.scipy.stats.norm.cdf((quality_a - quality_b) / SIGMA)


def simulate(
    quality_a: Float[np.ndarray, " votes"],
    quality_b: Float[np.ndarray, " votes"],
    generator: np.random.Generator,
) -> Bool[np.ndarray, " votes"]:
    """One vote each of a Thurstone Case V observer: whether A is preferred to B.

    **Arguments:** qualities [JND] of the two conditions of each comparison, and a
    seeded generator. No lapses and no ties.
    """
    scale = SIGMA / math.sqrt(2.0)
    a = generator.normal(quality_a, scale)
    b = generator.normal(quality_b, scale)
    return a > b
