"""What every metric asks of its arguments."""

import math

import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check

from .._picture import checked_picture


_PPD = (1.0, 1000.0)


def checked_pair(
    reference: ArrayLike, test: ArrayLike
) -> tuple[Float[Array, "height width 3"], Float[Array, "height width 3"]]:
    """Two pictures of one size. **Raises:** as `checked_picture`, or for two sizes."""
    pair = checked_picture("reference", reference), checked_picture("test", test)
    same_shape(*pair)
    return pair


def checked_light(name: str, light: ArrayLike) -> Float[Array, "height width 3"]:
    """Linear light without an upper end."""
    values = jnp.asarray(light)
    if values.ndim != 3 or values.shape[2] != 3 or values.size == 0:
        raise ValueError(
            f"`{name}` must have shape [height, width, 3], none of them 0, got "
            f"{values.shape}."
        )
    values = jnp.asarray(values, jnp.result_type(float))
    return check(name, values, lambda x: (x >= 0) & (x < jnp.inf), "finite and >= 0")


def same_shape(reference: Array, test: Array) -> None:
    if reference.shape != test.shape:
        raise ValueError(
            f"`test` must have the shape of `reference`, {reference.shape}, got "
            f"{test.shape}."
        )


def concrete(name: str, x: ArrayLike, remedy: str) -> None:
    if isinstance(x, jax.core.Tracer):
        raise ValueError(
            f"`{name}` must be a plain array here, got a traced one: {remedy}."
        )


def checked_ppd(ppd: ArrayLike) -> float:
    """A plain number of pixels to a visual degree."""
    low, high = _PPD
    rule = f"`ppd` must be a plain number in [{low:g}, {high:g}] px/deg"
    if isinstance(ppd, jax.core.Tracer):
        raise ValueError(
            f"{rule}, since the size of the filters follows from it, got a traced "
            "value: make it static."
        )
    try:
        value = np.asarray(ppd, float).item()
    except (TypeError, ValueError):
        value = math.nan
    if not low <= value <= high:
        raise ValueError(f"{rule}, got {ppd!r}.")
    return value
