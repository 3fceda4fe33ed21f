"""The frame that Jindal et al. (2021) published."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from ._buffers import Frame
from ._luminance import DEFAULT_LUMINANCE


def frame_from_jindal2021(
    *,
    motion_x: ArrayLike,
    motion_y: ArrayLike,
    material: ArrayLike,
    mip_level: ArrayLike,
    ppd: ArrayLike = 60.0,
    refresh_rate: ArrayLike = 60.0,
    resolution_px: tuple[int, int] = (1920, 1080),
    luminance: ArrayLike = DEFAULT_LUMINANCE,
) -> Frame:
    """The SciFi frame of Jindal et al. (2021) from the numbers in its files.

    **Arguments:**

    - `motion_x`, `motion_y`: as stored, in hundredths of the screen's width and height
        per frame.
    - `material`: index of the material, in the order of the published tables, from 0.
    - `mip_level`: as stored, from 0.
    - `ppd`, `refresh_rate`, `resolution_px`: the display. [px/deg], [Hz], [px]. The
        defaults are those of the authors' program.
    - `luminance`: [cd/m^2]. A number or one a tile; the file with the true one was not
        published.

    **Raises:** as `Frame`.

    **Source:** Jindal et al. (2021) and the program published with it.
    """
    width, height = resolution_px
    return Frame.from_pixels_per_frame(
        texture=material,
        mip_level=mip_level,
        motion_x=hundredths(motion_x, width),
        motion_y=hundredths(motion_y, height),
        luminance=luminance,
        ppd=ppd,
        refresh_rate=refresh_rate,
    )


def hundredths(motion: ArrayLike, side: int) -> Array:
    """Pixels per frame of motion in hundredths of a side of so many pixels."""
    return jnp.asarray(motion, jnp.result_type(float)) * (side / 100)
