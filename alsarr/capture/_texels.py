"""Every texture of a scene and its mip levels in one flat array."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int32, UInt8

from .._picture import decoded


class Texels(eqx.Module, strict=True):
    """All textures with their mip pyramids, row by row from the top of each image.

    Each level halves both sides, rounded down and at least 1, until one texel is left.
    A texel is the mean of the 2x2 below it; where a side is odd, of the area below it
    (three texels of unequal weight on that axis), so that every level keeps the
    texture's mean. Texture 0 is one white texel and texture 1 one flat normal,
    (0.5, 0.5, 1). Addresses repeat; u goes right and v down, as in glTF.

    - `texel`: linear light where a texture holds colour, plain values where it holds
        normals, roughness or metalness. [1], in [0, 1]
    - `offset`: index of the first texel of each level.
    - `width`, `height`: size of each level. [texels]. Levels that a texture does not
        have repeat its last one.
    - `levels`: how many levels each texture has. >= 1
    """

    texel: Float32[Array, "texels 3"]
    offset: Int32[Array, "textures levels"]
    width: Int32[Array, "textures levels"]
    height: Int32[Array, "textures levels"]
    levels: Int32[Array, " textures"]

    WHITE: ClassVar[int] = 0
    FLAT: ClassVar[int] = 1
    FIRST: ClassVar[int] = 2

    @classmethod
    def from_pictures(
        cls, pictures: Sequence[Float32[np.ndarray, "_ _ 3"]] = ()
    ) -> "Texels":
        """The pyramids of `pictures`, of any sizes; picture i is texture i + 2.

        **Raises:** `ValueError` for a picture without texels.
        """
        for index, picture in enumerate(pictures):
            if picture.size == 0:
                raise ValueError(
                    f"`pictures` must have texels, number {index} has none."
                )
        white, flat = np.ones((1, 1, 3)), np.array([[[0.5, 0.5, 1.0]]])
        pyramids = [_pyramid(p) for p in (white, flat, *pictures)]
        longest = max(len(pyramid) for pyramid in pyramids)
        sizes = np.array(
            [
                [pyramid[min(i, len(pyramid) - 1)].shape[:2] for i in range(longest)]
                for pyramid in pyramids
            ]
        )
        return cls(
            texel=jnp.asarray(
                np.concatenate([level.reshape(-1, 3) for p in pyramids for level in p])
            ),
            offset=jnp.asarray(_offsets(pyramids, longest), jnp.int32),
            width=jnp.asarray(sizes[:, :, 1], jnp.int32),
            height=jnp.asarray(sizes[:, :, 0], jnp.int32),
            levels=jnp.asarray([len(pyramid) for pyramid in pyramids], jnp.int32),
        )

    def picture(self, index: int) -> Float32[np.ndarray, "height width 3"]:
        """A texture at its finest level, as it was given; `index` is not checked."""
        start, width, height = (
            int(x[index, 0]) for x in (self.offset, self.width, self.height)
        )
        texels = np.asarray(self.texel[start : start + width * height])
        return texels.reshape(height, width, 3)


def linear_light(
    encoded: UInt8[np.ndarray, "height width 3"],
) -> Float32[np.ndarray, "height width 3"]:
    """Light as a share of white's, of sRGB bytes (IEC 61966-2-1)."""
    return np.asarray(decoded(jnp.arange(256, dtype=jnp.float32) / 255))[encoded]


def _pyramid(picture: Float[np.ndarray, "height width 3"]) -> list[np.ndarray]:
    levels = [np.asarray(picture, np.float32)]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(_halved(_halved(levels[-1], 0), 1))
    return levels


def _halved(texels: np.ndarray, axis: int) -> np.ndarray:
    """Half as many texels along one axis, each the mean of what it covers."""
    texels = np.moveaxis(texels, axis, 0)
    size, half = len(texels), len(texels) // 2
    if size == 1:
        less = texels
    elif size % 2 == 0:
        less = (texels[0::2] + texels[1::2]) / 2
    else:
        place = np.arange(half, dtype=np.float32)[:, None, None]
        less = (
            (half - place) * texels[0:-1:2]
            + half * texels[1::2]
            + (place + 1) * texels[2::2]
        ) / np.float32(size)
    return np.moveaxis(less, 0, axis)


def _offsets(pyramids: list[list[np.ndarray]], longest: int) -> np.ndarray:
    offsets, start = np.empty((len(pyramids), longest), np.int64), 0
    for row, pyramid in zip(offsets, pyramids, strict=True):
        for index, level in enumerate(pyramid):
            row[index:] = start
            start += level.shape[0] * level.shape[1]
    return offsets
