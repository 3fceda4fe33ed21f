"""Boundary checks shared by every public entry point."""

from collections.abc import Callable

import equinox as eqx
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike


def check(name: str, x: ArrayLike, ok: Callable[[Array], Array], rule: str) -> Array:
    """Return `x` as a floating array, or fail with a sentence that says what to change.

    Concrete values fail now with a plain `ValueError`. Traced values (inside `jit`,
    `vmap`, `grad`) are checked on the device through `equinox.error_if`; the returned
    array must be used, or the check is removed as dead code. NaN never passes.
    """
    dtype = jnp.result_type(x)
    if not jnp.issubdtype(dtype, jnp.floating):
        dtype = jnp.result_type(float)
    # An explicit dtype also drops the weak type, which would compile anew.
    x = jnp.asarray(x, dtype)
    message = f"`{name}` must be {rule}"
    good = ok(x)
    # A concrete array captured by a transformation is checked with traced operations.
    if isinstance(good, jax.core.Tracer):
        return eqx.error_if(x, ~jnp.all(good), f"{message}.")
    if not bool(jnp.all(good)):
        bad = x[~good].ravel()[0] if x.ndim else x
        raise ValueError(f"{message}, got {float(bad):g}.")
    return x


def check_flag(name: str, x: ArrayLike) -> Array:
    """Return `x` as a boolean array; anything but booleans, 0 and 1 is an error."""
    x = jnp.asarray(x)
    if x.dtype == bool:
        return x
    if isinstance(x, jax.core.Tracer):
        raise ValueError(f"`{name}` must be boolean, got {x.dtype}.")
    if not bool(jnp.all((x == 0) | (x == 1))):
        raise ValueError(f"`{name}` must be 0 or 1, got {x!s}.")
    return x.astype(bool)
