import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from camojab._errors import check

from .._rates import RATES


def choose_mode(
    errors: Float[Array, "*tiles 7"], threshold: ArrayLike
) -> Int[Array, "*tiles"]:
    """The cheapest rate whose error is below the threshold, and 1x1 if none is.

    It is the alternative to a budget: every tile decides for itself. Rates as cheap as
    each other (2x4 and 4x2, 1x2 and 2x1) are tried in the order of `alsarr.RATES`.

    **Arguments:**

    - `errors`: of each tile at each rate, in the order of `alsarr.RATES`; `extrapolate`
        has the rates first. [unit of the metric]. NaN is below nothing.
    - `threshold`: the same for all tiles. [unit of the metric], >= 0.

    **Returns:** index into `alsarr.RATES`.

    **Raises:** `ValueError` for a threshold that is negative or no single number.

    **Source:** Cardoso et al. 2022, Section 4.2.
    """
    limit = check("threshold", threshold, lambda t: t >= 0, ">= 0")
    if limit.ndim:
        raise ValueError(f"`threshold` must be one number, got shape {limit.shape}.")
    # The order of RATES is that of cost, and full rate is good enough for anything.
    below = (errors < limit.astype(errors.dtype)).at[..., len(RATES) - 1].set(True)
    return jnp.argmax(below, axis=-1)
