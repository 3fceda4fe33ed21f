"""What every oracle checks in the same words."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from camojab._errors import check

from .._frame import Frame


def checked_refresh_rate(refresh_rate: ArrayLike) -> Float[Array, ""]:
    """**Raises:** `ValueError` unless it is one number, > 0 Hz and finite."""
    good = lambda f: (f > 0) & jnp.isfinite(f)
    rate = check("refresh_rate", refresh_rate, good, "> 0 Hz and finite")
    if rate.ndim:
        raise ValueError(
            f"`refresh_rate` must be a single number, got shape {rate.shape}."
        )
    return rate.astype(float)


def positive(name: str, x: ArrayLike, unit: str) -> Float[Array, ""]:
    """A field of an oracle. **Raises:** `ValueError` unless > 0 and finite."""
    good = lambda v: (v > 0) & jnp.isfinite(v)
    return check(name, x, good, f"finite and > 0 {unit}".rstrip())


def known_texture(
    frame: Frame,
    holds: Callable[[Int[Array, " tiles"]], Bool[Array, " tiles"]],
    rule: str,
) -> Int[Array, " tiles"]:
    """Texture indices row by row. **Raises:** `ValueError` for one that is unknown."""
    known = lambda t: holds(t.ravel().astype(int)).reshape(t.shape)
    return check("frame.texture", frame.texture, known, rule).ravel().astype(int)
