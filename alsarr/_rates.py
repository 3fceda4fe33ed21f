"""The seven shading rates: their order, cost, colour and code, written down once."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8


TILE = 16
"""Width and height of a tile. [px]"""


@dataclass(frozen=True, eq=False)
class ShadingRates:
    """What is known of every shading rate. All arrays are read-only.

    - `names`: width x height of the coarse pixel, as text.
    - `size`: width m and height n of the coarse pixel. [px]
    - `resolution`: shading resolution (1/m, 1/n). [1], in (0, 1]
    - `cost`: shaded pixels of a 16x16 tile, 256/(mn) (Jindal et al. 2021, Eq. 27). [px]
    - `relative_cost`: the same with a 4x4 tile as the unit, 16/(mn). [1]
    - `colour`: the colours of the paper's rate maps, sRGB bytes.
    - `code`: the byte that Direct3D 12 and Vulkan read, (log2 m << 2) | log2 n.
    """

    names: tuple[str, ...]
    size: Int[np.ndarray, "rates 2"]
    resolution: Float[np.ndarray, "rates 2"]
    cost: Int[np.ndarray, " rates"]
    relative_cost: Int[np.ndarray, " rates"]
    colour: UInt8[np.ndarray, "rates 3"]
    code: UInt8[np.ndarray, " rates"]

    def __len__(self) -> int:
        return len(self.names)


def _frozen(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array


def _describe(colours: dict[str, str]) -> ShadingRates:
    size = np.array([[int(side) for side in name.split("x")] for name in colours])
    area = size.prod(axis=1)
    octaves = np.log2(size).astype(np.uint8)
    return ShadingRates(
        names=tuple(colours),
        size=_frozen(size),
        resolution=_frozen(1.0 / size),
        cost=_frozen(TILE**2 // area),
        relative_cost=_frozen(16 // area),
        colour=_frozen(
            np.array([list(bytes.fromhex(c)) for c in colours.values()], np.uint8)
        ),
        code=_frozen(octaves[:, 0] << 2 | octaves[:, 1]),
    )


RATES = _describe(
    {
        "4x4": "ED1C24",
        "2x4": "EE8722",
        "4x2": "FBB040",
        "2x2": "8DC63F",
        "1x2": "2BB673",
        "2x1": "00A79D",
        "1x1": "1C75BC",
    }
)
"""The seven rates, always in this order; a rate index anywhere is an index into it."""


def nearest_finer(available: tuple[str, ...]) -> Int[np.ndarray, "7"]:
    """What stands in for each of the seven rates where hardware has only some.

    It is the available rate that is no coarser on either axis and has the largest
    coarse pixel: no tile is shaded more coarsely than was asked for. Of two as large
    it is the first in the order of `RATES`.

    **Arguments:**

    - `available`: names of rates, among them 1x1, which all hardware has.

    **Returns:** index of the rate to use in the place of each; its own if available.

    **Raises:** `ValueError` for a name that is no rate, or without 1x1.
    """
    return np.array([finest_within(size, available) for size in RATES.size])


def finest_within(size: Int[np.ndarray, "2"], available: tuple[str, ...]) -> int:
    """Index of the largest available rate no wider and no higher than `size` [px]."""
    unknown = [name for name in available if name not in RATES.names]
    if unknown or "1x1" not in available:
        raise ValueError(
            f"`available` must be 1x1 and others of {', '.join(RATES.names)}, got "
            f"{', '.join(available) or 'none'}."
        )
    usable = [i for i in range(len(RATES)) if RATES.names[i] in available]
    usable = [i for i in usable if np.all(RATES.size[i] <= size)]
    return min(usable, key=lambda i: RATES.cost[i])
