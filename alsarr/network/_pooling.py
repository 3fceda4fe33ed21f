"""How far each layer pools, and pooling itself."""

import functools
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def pool_sizes(region: int, layers: int = 5) -> tuple[int, ...]:
    """By how much each layer pools so that one output is one region.

    The first layer never pools. Layer 2 is i = 0 of the paper's Eq. 1: that is the
    count that gives Table 3, and the released networks. Where Eq. 1 makes the region,
    which it does for every power of two up to 2^(layers - 1), this is Eq. 1: 2 as long
    as more than 2 is left, then what is left, then 1. Elsewhere what it prints has
    another product (the next power of two, and for five layers never more than 16), so
    a layer pools by 2 only while what is left is even, and what is left then or in the
    last layer is pooled at once: 12 is 1, 2, 2, 3, 1 and 32 is 1, 2, 2, 2, 4.

    **Arguments:**

    - `region`: width and height of a region, w. [px], > 0
    - `layers`: of the network. > 0, and > 1 for a region of more than one pixel.

    **Returns:** pooling factor of each layer; their product is `region`.

    **Raises:** `ValueError` for a region or number of layers that is out of range.

    **Source:** Cardoso et al. 2022, Eq. 1 and Table 3.
    """
    if region < 1:
        raise ValueError(f"`region` must be > 0 px, got {region}.")
    if layers < 1 or (layers == 1 and region > 1):
        raise ValueError(
            f"`layers` must be > 0, and > 1 where regions are pooled, got {layers}."
        )
    sizes, left = [1], region
    while len(sizes) < layers:
        last = len(sizes) == layers - 1
        sizes.append(left if last or left % 2 else 2)
        left //= sizes[-1]
    return tuple(sizes)


def max_pool(
    x: Float[Array, "batch height width channels"], size: int
) -> Float[Array, "batch rows columns channels"]:
    """Largest of each block of `size` x `size`, of which sizes are multiples."""
    # Elementwise maxima fuse with what comes before; a reduction over windows does not.
    for axis in (1, 2):
        parts = [
            jax.lax.slice_in_dim(x, i, None, stride=size, axis=axis)
            for i in range(size)
        ]
        x = functools.reduce(jnp.maximum, parts)
    return x


def pad_to_regions(
    x: Float[Array, "*n height width"], region: int
) -> Float[Array, "*n high wide"]:
    """With the last row and column repeated until sizes are multiples of `region`.

    A picture that simply goes on has no edge where it ended, which the maximum of a
    region would pick up. (The released renderer appends zeros.)
    """
    height, width = x.shape[-2:]
    missing = [(0, -height % region), (0, -width % region)]
    if not math.prod(x.shape):
        raise ValueError(f"`x` must have pixels, got shape {x.shape}.")
    if not any(after for _, after in missing):
        return x
    return jnp.pad(x, [(0, 0)] * (x.ndim - 2) + missing, mode="edge")
