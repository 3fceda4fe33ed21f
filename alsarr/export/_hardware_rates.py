"""A rate map for the tiles and the rates that hardware has."""

import numpy as np
from jaxtyping import ArrayLike, Int

from .._rates import finest_within, nearest_finer, RATES, TILE
from ._rate_map import check_tile, checked_map


def adapt_rates(
    rate: ArrayLike,
    *,
    tile: int = TILE,
    size_px: tuple[int, int] | None = None,
    available: tuple[str, ...] = RATES.names,
) -> Int[np.ndarray, "rows columns"]:
    """The map of 16-px tiles as hardware with other tiles and fewer rates takes it.

    A tile of 8 px has the rate of the tile it lies in. One of 32 px has the finest of
    up to four, on each axis alone, and then the nearest finer of the seven. Rates that
    are missing become the nearest finer: nothing is shaded more coarsely than `rate`.

    **Arguments:**

    - `rate`: as in `write_rates_bin`; a tile is 16 px wide and high.
    - `tile`: width and height of the hardware's tile. [px], 8, 16 or 32.
    - `size_px`: width and height of the frame. [px]. `None`: whole tiles. A last row
        or column that the frame fills only in part may be missing from `rate`; it then
        has the rates of its neighbours.
    - `available`: names of the rates that the hardware has, 1x1 among them. Direct3D 12
        without additional rates lacks 4x4, 2x4 and 4x2; Vulkan promises 2x2, 2x1 and
        1x1 only.

    **Returns:** indices of rates, shape `[ceil(height / tile), ceil(width / tile)]`.

    **Raises:** `ValueError` for a tile, a size or a rate other than that.

    **Source:** Microsoft DirectX-Specs, Variable Rate Shading; Vulkan specification,
    Primitive Fragment Shading Rate.

    **Example:**

    >>> import numpy as np
    >>> from alsarr import RATES
    >>> from alsarr.export import adapt_rates
    >>> rate = np.array([[RATES.names.index("4x4"), RATES.names.index("1x2")]])
    >>> adapted = adapt_rates(rate, available=("1x1", "1x2", "2x1", "2x2"))
    >>> [RATES.names[i] for i in adapted.ravel()]
    ['2x2', '1x2']
    """
    rate, tile = checked_map(rate), check_tile(tile)
    replacement = nearest_finer(available)
    width, height = _pixels(rate, size_px)
    rows = _covered(-(-height // tile), tile, rate.shape[0])
    columns = _covered(-(-width // tile), tile, rate.shape[1])
    if tile <= TILE:
        return replacement[rate[np.ix_(rows[0], columns[0])]]
    four = [RATES.size[rate[np.ix_(r, c)]] for r in rows for c in columns]
    octaves = np.log2(np.min(four, axis=0)).astype(int)
    return replacement[_BY_OCTAVES[octaves[..., 0], octaves[..., 1]]]


# The nearest finer of the seven for each (log2 m, log2 n), as 1x4 and 4x1 are none.
_BY_OCTAVES = np.array(
    [
        [finest_within(np.array([2**m, 2**n]), RATES.names) for n in range(3)]
        for m in range(3)
    ]
)


def _covered(count: int, tile: int, tiles: int) -> tuple[np.ndarray, np.ndarray]:
    """First and last 16-px tile under each of `count` hardware tiles along an axis."""
    start = np.arange(count) * tile
    first, last = start // TILE, (start + tile - 1) // TILE
    return np.minimum(first, tiles - 1), np.minimum(last, tiles - 1)


def _pixels(rate: np.ndarray, size_px: tuple[int, int] | None) -> tuple[int, int]:
    rows, columns = rate.shape
    if size_px is None:
        return columns * TILE, rows * TILE
    width, height = size_px
    for side, tiles in ((width, columns), (height, rows)):
        if side < 1 or tiles not in (side // TILE, -(-side // TILE)):
            raise ValueError(
                f"`size_px` must be that of {columns} x {rows} tiles of {TILE} px, "
                f"got {width} x {height}."
            )
    return width, height
