"""A G-buffer at tile resolution: what is seen in each 16x16 tile, and how it moves."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from camojab._errors import check
from camojab._math import safe_hypot

from .._picture import checked_picture
from .._rates import TILE
from ._luminance import default_luminance


class Frame(eqx.Module, strict=True):
    """One frame of the renderer's auxiliary buffers, one value a tile.

    The arrays have the shape `[rows, columns]` of the rate map, the top row first.
    Wherever tiles are numbered, they are numbered row by row.

    **Arguments:**

    - `texture`: index of the texture that the tile shows. Whole numbers, >= 0.
    - `mip_level`: level at which full-rate shading samples it. [octaves], >= 0.
    - `velocity_x`, `velocity_y`: slowest motion in the tile along each axis (the
        conservative choice of Jindal et al. 2021, Eq. 28). [deg/s], >= 0. A single
        number stands for every tile.
    - `luminance`: mean luminance of the tile, such as `tile_luminance` finds it.
        [cd/m^2], >= 0. A single number stands for every tile. Left out it is
        `DEFAULT_LUMINANCE`, with a `UserWarning`.
    - `previous_image`: the final picture before this frame, sRGB-encoded, for the
        oracles that look at pixels: [height, width, 3] of any height and width that
        make as many tiles, the last of them cut by the edge or not. [1], in [0, 1];
        integers count from 0 to the largest value of their type.
    - `channels`: buffers of the renderer by name, such as `alsarr.capture.CHANNELS`
        lists them, for the oracles that read them: each [height, width], of any height
        and width that make as many tiles. Finite.

    **Raises:** `ValueError` for a shape that differs from that of `texture`, a texture
    index that is no whole number, and a value that is out of range or not finite; under
    a JAX transformation bad values are raised at run time in the same words.
    """

    texture: Int[Array, "rows columns"]
    mip_level: Float[Array, "rows columns"]
    velocity_x: Float[Array, "rows columns"]
    velocity_y: Float[Array, "rows columns"]
    luminance: Float[Array, "rows columns"]
    previous_image: Float[Array, "height width 3"] | None
    channels: dict[str, Float[Array, "height width"]] | None

    UNITS: ClassVar[dict[str, str]] = {
        "texture": "index",
        "mip_level": "octaves",
        "velocity_x": "deg/s",
        "velocity_y": "deg/s",
        "luminance": "cd/m^2",
    }

    def __init__(
        self,
        *,
        texture: ArrayLike,
        mip_level: ArrayLike,
        velocity_x: ArrayLike,
        velocity_y: ArrayLike,
        luminance: ArrayLike | None = None,
        previous_image: ArrayLike | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
    ):
        if luminance is None:
            luminance = default_luminance()
        self.texture = _texture_index(texture)
        shape = self.texture.shape
        self.mip_level = _per_tile("mip_level", mip_level, shape)
        self.velocity_x = _per_tile("velocity_x", velocity_x, shape)
        self.velocity_y = _per_tile("velocity_y", velocity_y, shape)
        self.luminance = _per_tile("luminance", luminance, shape)
        self.previous_image = _previous(previous_image, shape)
        self.channels = _channels(channels, shape)

    @classmethod
    def from_degrees(
        cls,
        *,
        texture: ArrayLike,
        mip_level: ArrayLike,
        motion_x: ArrayLike,
        motion_y: ArrayLike,
        luminance: ArrayLike | None = None,
        previous_image: ArrayLike | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
    ) -> "Frame":
        """From signed motion in degrees per second; only its magnitude is kept."""
        return cls(
            texture=texture,
            mip_level=mip_level,
            velocity_x=jnp.abs(jnp.asarray(motion_x)),
            velocity_y=jnp.abs(jnp.asarray(motion_y)),
            luminance=luminance,
            previous_image=previous_image,
            channels=channels,
        )

    @classmethod
    def from_pixels_per_frame(
        cls,
        *,
        texture: ArrayLike,
        mip_level: ArrayLike,
        motion_x: ArrayLike,
        motion_y: ArrayLike,
        ppd: ArrayLike,
        refresh_rate: ArrayLike,
        resolution_px: tuple[int, int] | None = None,
        luminance: ArrayLike | None = None,
        previous_image: ArrayLike | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
    ) -> "Frame":
        """From motion vectors in pixels per frame; only their magnitude is kept.

        `refresh_rate` [Hz] is the rate at which those frames follow one another, `ppd`
        [px/deg] belongs to the full-resolution pixels that the vectors count. If
        `resolution_px`, the picture's width and height, is given, no tile may move
        further than that in one frame: such numbers are of another unit.
        """
        speed = _degrees_per_second(ppd, refresh_rate)
        motion_x, motion_y = _default_float(motion_x), _default_float(motion_y)
        if resolution_px is not None:
            width, height = _resolution(resolution_px)
            unit = "px a frame (more looks like deg/s: `from_degrees`)"
            motion_x = _within("motion_x", motion_x, width, unit)
            motion_y = _within("motion_y", motion_y, height, unit)
        return cls.from_degrees(
            texture=texture,
            mip_level=mip_level,
            motion_x=motion_x * speed,
            motion_y=motion_y * speed,
            luminance=luminance,
            previous_image=previous_image,
            channels=channels,
        )

    @classmethod
    def from_uv_per_frame(
        cls,
        *,
        texture: ArrayLike,
        mip_level: ArrayLike,
        motion_x: ArrayLike,
        motion_y: ArrayLike,
        resolution_px: tuple[int, int],
        ppd: ArrayLike,
        refresh_rate: ArrayLike,
        luminance: ArrayLike | None = None,
        previous_image: ArrayLike | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
    ) -> "Frame":
        """From motion in shares of the picture's width and height per frame.

        `resolution_px` is that width and height in pixels of `ppd`; the rest is as in
        `from_pixels_per_frame`. A share beyond +-1 is an error: hardly anything that is
        seen moves so far in one frame, and numbers of pixels nearly always do.
        """
        width, height = _resolution(resolution_px)
        unit = "a frame (more looks like pixels: `from_pixels_per_frame`)"
        return cls.from_pixels_per_frame(
            texture=texture,
            mip_level=mip_level,
            motion_x=_within("motion_x", _default_float(motion_x), 1, unit) * width,
            motion_y=_within("motion_y", _default_float(motion_y), 1, unit) * height,
            ppd=ppd,
            refresh_rate=refresh_rate,
            luminance=luminance,
            previous_image=previous_image,
            channels=channels,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the rate map."""
        rows, columns = self.texture.shape
        return rows, columns


def mean_velocity(frame: Frame) -> Float[Array, ""]:
    """Average speed over the tiles (Jindal et al. 2021, Section 5.2). [deg/s]

    **Example:**

    >>> from alsarr import mean_velocity, procedural_frame
    >>> frame = procedural_frame(3, rows=9, columns=16, seed=1)
    >>> f"{mean_velocity(frame):.1f}"  # [deg/s]
    '12.6'
    """
    return jnp.mean(safe_hypot(frame.velocity_x, frame.velocity_y))


def _positive(x: Array) -> Array:
    return (x > 0) & jnp.isfinite(x)


def _default_float(x: ArrayLike) -> Array:
    """Half-precision buffers are widened before anything is computed from them."""
    return jnp.asarray(x, jnp.result_type(float))


def _degrees_per_second(ppd: ArrayLike, refresh_rate: ArrayLike) -> Array:
    """Velocity of one pixel a frame."""
    rate = check("refresh_rate", refresh_rate, _positive, "> 0 Hz and finite")
    density = check("ppd", ppd, _positive, "> 0 px/deg and finite")
    return _default_float(rate) / _default_float(density)


def _resolution(resolution_px: tuple[int, int]) -> tuple[int, int]:
    width, height = resolution_px
    if min(width, height) < 1:
        raise ValueError(
            f"`resolution_px` must be a width and a height >= 1 px, got {width} x "
            f"{height}."
        )
    return width, height


def _within(name: str, motion: Array, most: int, unit: str) -> Array:
    rule = f"within +-{most} {unit}"
    return check(name, motion, lambda x: jnp.abs(x) <= most, rule)


def _texture_index(texture: ArrayLike) -> Array:
    texture = jnp.asarray(texture)
    if texture.ndim != 2 or texture.size == 0:
        raise ValueError(
            f"`texture` must have shape [rows, columns], none of them 0, "
            f"got {texture.shape}."
        )
    whole = lambda t: (t >= 0) & (t == jnp.round(t)) & jnp.isfinite(t)
    checked = check("texture", texture, whole, "a whole number >= 0")
    return checked.astype(jnp.int32)


def _per_tile(name: str, x: ArrayLike, shape: tuple[int, ...]) -> Array:
    x = _default_float(x)
    if x.shape not in (shape, ()):
        raise ValueError(
            f"`{name}` must have the shape of `texture`, {shape}, got {x.shape}."
        )
    rule = f">= 0 {Frame.UNITS[name]} and finite"
    x = check(name, x, lambda v: (v >= 0) & jnp.isfinite(v), rule)
    return jnp.broadcast_to(x, shape)


def _previous(image: ArrayLike | None, shape: tuple[int, ...]) -> Array | None:
    if image is None:
        return None
    checked = checked_picture("previous_image", image)
    height, width, _ = checked.shape
    _same_tiles("previous_image", height, width, shape)
    return checked


def _channels(
    channels: Mapping[str, ArrayLike] | None, shape: tuple[int, ...]
) -> dict[str, Array] | None:
    if channels is None:
        return None
    return {name: _channel(name, x, shape) for name, x in channels.items()}


def _channel(name: str, x: ArrayLike, shape: tuple[int, ...]) -> Array:
    of = f'channels["{name}"]'
    x = check(of, _default_float(x), jnp.isfinite, "finite")
    if x.ndim != 2 or x.size == 0:
        raise ValueError(
            f"`{of}` must have shape [height, width], none of them 0, got {x.shape}."
        )
    height, width = x.shape
    _same_tiles(of, height, width, shape)
    return x


def _same_tiles(name: str, height: int, width: int, shape: tuple[int, ...]) -> None:
    tiles = -(-height // TILE), -(-width // TILE)
    if tiles != shape:
        raise ValueError(
            f"`{name}` must have the tiles of `texture`, {shape}, got {tiles}, "
            f"those of {width} x {height} px."
        )
