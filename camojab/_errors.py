"""Boundary checks shared by every public entry point."""

from collections.abc import Callable

import equinox as eqx
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike


def check(name: str, x: ArrayLike, ok: Callable[[Array], Array], rule: str) -> Array:
    """Return `x` as a floating array, or fail with a sentence that says what to change.

    Concrete values fail now with a plain `ValueError`. Traced values (inside `jit`,
    `vmap`, `grad`) are checked on the device through `equinox.error_if`; the returned
    array must be used, or the check is removed as dead code. NaN never passes.
    """
    message = f"`{name}` must be {rule}"
    try:
        dtype = jnp.result_type(x)
        if x is None or jnp.issubdtype(dtype, jnp.complexfloating):
            raise TypeError
    except (TypeError, ValueError):
        raise ValueError(f"{message}, got {x!r}.") from None
    if not jnp.issubdtype(dtype, jnp.floating):
        dtype = jnp.result_type(float)
    # An explicit dtype also drops the weak type, which would compile anew.
    x = jnp.asarray(x, dtype)
    good = ok(x)
    # A concrete array captured by a transformation is checked with traced operations.
    if isinstance(good, jax.core.Tracer):
        return eqx.error_if(x, ~jnp.all(good), f"{message}.")
    if not bool(jnp.all(good)):
        bad = x[~good].ravel()[0] if x.ndim else x
        raise ValueError(f"{message}, got {shown(float(bad))}.")
    return x


def shown(value: float) -> str:
    """A number in few digits, unless few digits would make it another number."""
    short = f"{value:g}"
    return short if float(short) == value or value != value else repr(value)


def check_flag(name: str, x: ArrayLike) -> Array:
    """Return `x` as a boolean array; anything but booleans, 0 and 1 is an error."""
    if isinstance(x, jax.core.Tracer):
        if x.dtype != bool:
            raise ValueError(f"`{name}` must be boolean, got {x.dtype}.")
        return x
    flags = np.asarray(x)
    wrong = flags[(flags != 0) & (flags != 1)]
    if wrong.size:
        raise ValueError(f"`{name}` must be 0 or 1, got {wrong.ravel()[0]}.")
    return jnp.asarray(flags, bool)
