"""Metrics by name, one value a tile: what a network learns to predict."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._picture import block_means
from .._rates import TILE
from ._checks import checked_ppd
from ._flip import flip
from ._lpips import lpips, LpipsWeights
from ._pooling import pool_tiles
from ._psnr import decibels, squared_error
from ._weber import jnflip, jnyang
from ._yang2019 import yang2019


Metric = Callable[..., Float[Array, "rows columns"]]
"""A function of `reference`, `test` and, by name, `ppd`: one value for each tile."""


def lpips_metric(weights: LpipsWeights, *, centred: bool = True) -> Metric:
    """`lpips` in the form of `METRICS`: the largest value of each tile.

    **Arguments:** as for `lpips`; Cardoso et al. 2022 trained with `centred=False`.

    **Returns:** a function of two pictures and `ppd`, which it does not look at.
    """

    def metric(
        reference: ArrayLike, test: ArrayLike, *, ppd: ArrayLike
    ) -> Float[Array, "rows columns"]:
        checked_ppd(ppd)
        return pool_tiles(lpips(reference, test, weights, centred=centred))

    return metric


def _flip(
    reference: ArrayLike, test: ArrayLike, *, ppd: ArrayLike
) -> Float[Array, "rows columns"]:
    return pool_tiles(flip(reference, test, ppd=ppd))


def _jnflip(
    reference: ArrayLike, test: ArrayLike, *, ppd: ArrayLike
) -> Float[Array, "rows columns"]:
    return pool_tiles(jnflip(reference, test, ppd=ppd))


def _psnr(
    reference: ArrayLike, test: ArrayLike, *, ppd: ArrayLike
) -> Float[Array, "rows columns"]:
    checked_ppd(ppd)
    error = block_means(squared_error(reference, test), TILE, TILE)
    # 1/0.015 dB, from where on the transform is 0: equal tiles would be infinite.
    return decibels(jnp.maximum(error, 10 ** (-0.1 / 0.015)))


def _jnyang(
    reference: ArrayLike, test: ArrayLike, *, ppd: ArrayLike
) -> Float[Array, "rows columns"]:
    checked_ppd(ppd)
    return pool_tiles(jnyang(reference, test))


def _yang(
    reference: ArrayLike, test: ArrayLike, *, ppd: ArrayLike
) -> Float[Array, "rows columns"]:
    checked_ppd(ppd)
    return pool_tiles(yang2019(reference, test))


METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        "flip": _flip,
        "jnflip": _jnflip,
        "psnr": _psnr,
        "jnyang": _jnyang,
        "yang": _yang,
    }
)
"""Metrics by name: functions of `reference`, `test` and `ppd` [px/deg].

Each takes sRGB-encoded pictures of shape [height, width, 3] in [0, 1] and gives one
value for each tile of 16 x 16 pixels, those that the edge cuts included: the largest of
the tile's pixels, but for "psnr". Only FLIP looks at `ppd`, and all ask for it. The
Weber-corrected ones assume next to no light in the environment, as `weber` explains.

What Cardoso et al. 2022 made of them to train on, clipped to [0, 1]: "flip" times 2,
"jnflip" times 0.25, "jnyang" times 0.7, "yang" as it is, LPIPS as it is, and of "psnr",
which is larger where the error is smaller, 1 - 0.015 PSNR. That reaches 0 at 66.7 dB,
and "psnr" ends there, so that equal tiles are finite.
"""
