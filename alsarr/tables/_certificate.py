"""How far tables are from the model where they were not fitted."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ._domain import Conditions


class Certificate(eqx.Module):
    """Absolute errors of polynomials over held-out conditions. [JND].

    One number a polynomial, with the axes entry, rate and direction:

    - `largest`, `percentile_99`, `median`.

    And the same three over all polynomials that are not 0 by definition:

    - `overall`.

    The conditions, so that anyone can try them again:

    - `sample`.
    """

    largest: Float[Array, "entries rates directions"]
    percentile_99: Float[Array, "entries rates directions"]
    median: Float[Array, "entries rates directions"]
    overall: Float[Array, "3"]
    sample: Conditions

    def __init__(
        self,
        *,
        largest: ArrayLike,
        percentile_99: ArrayLike,
        median: ArrayLike,
        overall: ArrayLike,
        sample: Conditions,
    ):
        own = lambda x: jnp.asarray(x, jnp.result_type(float))
        self.largest = own(largest)
        self.percentile_99 = own(percentile_99)
        self.median = own(median)
        self.overall = own(overall)
        self.sample = Conditions(*map(own, sample))


def percentiles(error: Float[np.ndarray, "... n"]) -> Float[np.ndarray, "... 3"]:
    """Largest, 99th percentile and median over the last axis."""
    n = error.shape[-1]
    # Order statistics themselves: an interpolated one may be smaller than any error.
    places = [n - 1, min(n - 1, int(np.ceil(0.99 * n))), n // 2]
    return np.partition(error, sorted(set(places)), axis=-1)[..., places]
