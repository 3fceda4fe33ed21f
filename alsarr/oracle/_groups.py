"""Tiles in blocks of a fixed size, each of tiles that share an entry.

What belongs to an entry, such as a texture at a mip level, is then read once a block
and not once a tile, and all shapes are known before the tiles are.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


class Blocks(NamedTuple):
    """Made by `in_blocks`.

    - `entry`: that the tiles of a block share.
    - `tile`: those of each block; the last ones again where it is not full.
    - `used`: whether any tile needs the block; the others are the last ones.
    - `place`: of each tile, in the blocks one after another.
    """

    entry: Int[Array, " blocks"]
    tile: Int[Array, "blocks size"]
    used: Bool[Array, " blocks"]
    place: Int[Array, " tiles"]


def in_blocks(entry: Int[Array, " tiles"], entries: int, size: int) -> Blocks:
    """Blocks of `size` tiles, as many as the most uneven distribution would need.

    **Arguments:** `entry`: of each tile. In [0, `entries`).
    """
    tiles = entry.size
    order = jnp.argsort(entry)
    count = jnp.zeros(entries, int).at[entry].add(1)
    first_tile = jnp.cumsum(count) - count
    past_block = jnp.cumsum(-(-count // size))
    first_block = past_block + -count // size

    most = (tiles + min(entries, tiles) * (size - 1)) // size
    block = jnp.arange(most)
    owner = jnp.searchsorted(past_block, block, side="right", method="compare_all")
    owner = jnp.minimum(owner, entries - 1)
    nth = (block - first_block[owner])[:, None] * size + jnp.arange(size)[None]
    nth = first_tile[owner][:, None] + jnp.minimum(nth, count[owner][:, None] - 1)

    rank = jnp.zeros(tiles, int).at[order].set(jnp.arange(tiles)) - first_tile[entry]
    return Blocks(
        entry=owner,
        tile=order[jnp.clip(nth, 0, tiles - 1)],
        used=block < past_block[-1],
        place=first_block[entry] * size + rank,
    )
