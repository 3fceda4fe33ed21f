"""Which shading samples a rate needs, and which pixels each of them colours."""

import functools
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float32, Int, Int32


# What stands in a cell beyond the picture's edge; -1 is the sky's.
_NOTHING = -2


@dataclass(frozen=True, eq=False)
class Invocations:
    """Shading samples of a picture, in the order of their cells, row by row.

    - `triangle`: that each sample is of; -1 is the sky.
    - `centre`: of its coarse pixel. [px], x and y
    - `covered`: of the pixel nearest to that centre that shows the triangle. [px]
    - `owner`: index of the sample that colours each pixel.
    """

    triangle: Int32[np.ndarray, " samples"]
    centre: Float32[np.ndarray, "samples 2"]
    covered: Float32[np.ndarray, "samples 2"]
    owner: Int32[np.ndarray, "height width"]

    def __len__(self) -> int:
        return len(self.triangle)


def every_pixel(triangle: Int[np.ndarray, "height width"]) -> Invocations:
    """One sample for each pixel, at its centre: how a plain picture is shaded."""
    height, width = triangle.shape
    y, x = np.mgrid[:height, :width].astype(np.float32) + np.float32(0.5)
    centre = np.stack([x.ravel(), y.ravel()], axis=1)
    owner = np.arange(height * width, dtype=np.int32).reshape(height, width)
    return Invocations(triangle.ravel().astype(np.int32), centre, centre, owner)


def coarse_invocations(
    triangle: Int[np.ndarray, "height width"], cell: tuple[int, int]
) -> Invocations:
    """One sample for each coarse pixel and each triangle that is seen in it.

    Coarse pixels lie side by side from the top left corner; what the picture's edge
    cuts off has no part in it, but their centre stays where it is. The sky counts as a
    triangle that is everywhere.

    **Arguments:**

    - `triangle`: seen by each pixel; -1 is the sky.
    - `cell`: width and height of the coarse pixel. [px]

    **Source:** Direct3D 12's specification of variable-rate shading: coverage is that
    of full resolution, one shading sample a coarse pixel and primitive, at the coarse
    pixel's centre, unless that is not covered.
    """
    height, width = triangle.shape
    wide, high = cell
    columns = -(-width // wide)
    leads, leader, nearest, seen = (
        np.asarray(x) for x in _grouped(jnp.asarray(triangle, jnp.int32), cell)
    )
    place = np.argwhere(leads)
    corner = np.stack([place[:, 0] % columns * wide, place[:, 0] // columns * high], 1)
    half = np.array([wide / 2, high / 2])
    near = nearest[leads]
    offset = np.stack([near % wide, near // wide], axis=1) + 0.5
    number = np.cumsum(leads.ravel()).reshape(leads.shape) - 1
    owner = np.take_along_axis(number, leader, axis=1).astype(np.int32)
    return Invocations(
        triangle=seen[leads],
        centre=(corner + half).astype(np.float32),
        covered=(corner + offset).astype(np.float32),
        owner=_pixels(owner, cell, columns)[:height, :width],
    )


@functools.partial(jax.jit, static_argnames="cell")
def _grouped(
    triangle: Int32[Array, "height width"], cell: tuple[int, int]
) -> tuple[
    Bool[Array, "cells places"],
    Int32[Array, "cells places"],
    Int32[Array, "cells places"],
    Int32[Array, "cells places"],
]:
    """Of every place of every cell, four things.

    Whether it is the first to show its triangle, which place is, which place of that
    triangle is nearest to the middle, and the triangle.
    """
    wide, high = cell
    height, width = triangle.shape
    missing = ((0, -height % high), (0, -width % wide))
    padded = jnp.pad(triangle, missing, constant_values=_NOTHING)
    rows, columns = padded.shape[0] // high, padded.shape[1] // wide
    seen = padded.reshape(rows, high, columns, wide).transpose(0, 2, 1, 3)
    seen = seen.reshape(rows * columns, high * wide)
    # A cell has sixteen pixels at most: comparing them all is cheaper than sorting.
    same = seen[:, :, None] == seen[:, None, :]
    leader = jnp.argmax(same, axis=2).astype(jnp.int32)
    place = np.arange(high * wide)
    away = np.hypot(place % wide + 0.5 - wide / 2, place // wide + 0.5 - high / 2)
    distance = jnp.where(same, jnp.asarray(away, jnp.float32)[None, None], jnp.inf)
    nearest = jnp.argmin(distance, axis=2).astype(jnp.int32)
    first = leader == jnp.asarray(place, jnp.int32)[None]
    return first & (seen != _NOTHING), leader, nearest, seen


def _pixels(
    values: Int32[np.ndarray, "cells places"], cell: tuple[int, int], columns: int
) -> Int32[np.ndarray, "height width"]:
    """Places of cells as pixels of the picture."""
    wide, high = cell
    rows = len(values) // columns
    grid = values.reshape(rows, columns, high, wide).transpose(0, 2, 1, 3)
    return grid.reshape(rows * high, columns * wide)
