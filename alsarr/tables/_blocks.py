"""Many tiles, some at a time: what is gathered for all at once leaves the caches."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Shaped


# Of a few thousand tiles the coefficients stay in the cache of a core.
_TILES = 8192


def in_blocks(
    of: Callable[..., Float[Array, "some 7"]], *arrays: Shaped[Array, " tiles"]
) -> Float[Array, "tiles 7"]:
    """What `of` gives for all tiles, asked for a few thousand of them at a time."""
    tiles = arrays[0].size
    if tiles <= _TILES:
        return of(*arrays)
    whole = tiles - tiles % _TILES
    blocks = tuple(x[:whole].reshape(-1, _TILES) for x in arrays)
    found = jax.lax.map(lambda some: of(*some), blocks).reshape(whole, -1)
    if whole == tiles:
        return found
    return jnp.concatenate([found, of(*(x[whole:] for x in arrays))])
