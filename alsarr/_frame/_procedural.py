"""A drawn street scene."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._rates import TILE
from ._buffers import Frame


def procedural_frame(textures: int, *, rows: int, columns: int, seed: int) -> Frame:
    """A drawn street scene, for runs without data.

    A camera moves forward and turns between two rows of buildings under a sky, while
    something crosses in front of it. Mip levels rise with distance, velocities follow
    from the camera's motion (up to some tens of deg/s), and luminance goes from
    1 cd/m^2 in the deepest shade to 300 cd/m^2 where it is brightest. The same
    arguments give the same frame.

    **Arguments:**

    - `textures`: how many textures to use; indices are 0 to `textures - 1`. >= 1.
    - `rows`, `columns`: size in tiles. >= 1.
    - `seed`: of NumPy's default generator. >= 0.

    **Raises:** `ValueError` for a size or number below 1.
    """
    for name, value in {"textures": textures, "rows": rows, "columns": columns}.items():
        if value < 1:
            raise ValueError(f"`{name}` must be >= 1, got {value}.")
    rng = np.random.default_rng(seed)
    x, y = _rays(rows, columns)
    surface, distance = _street(x, y)
    panels = rng.integers(0, textures, size=64)
    bay = (distance / 5).astype(int) % 32 + np.where(x > 0, 32, 0)
    texture = np.select(
        [surface == _GROUND, surface == _WALL, surface == _CROSSING],
        [0, panels[bay], 2 % textures],
        textures - 1,
    )
    near = np.where(surface == _SKY, 1.0, np.maximum(distance / 2, 1.0))
    motion_x, motion_y = _flow(x, y, surface, distance, turn=rng.uniform(4, 12))
    return Frame.from_degrees(
        texture=texture,
        mip_level=np.floor(np.log2(near)),
        motion_x=motion_x,
        motion_y=motion_y,
        luminance=_light(x, y, surface, distance, rng),
    )


def procedural_picture(
    frame: Frame,
    textures: Sequence[Float[np.ndarray, "size size"]],
    *,
    peak_luminance: float | int,
) -> Float[np.ndarray, "height width 3"]:
    """A grey picture of a frame, for what looks at pixels: its textures, tile by tile.

    A tile shows, a texel a pixel, the part of its texture's mip level that lies where
    the tile does, repeated over the whole picture. Its light is that of the texture
    about its mean, times the luminance of the tile; neither perspective nor filtering
    between levels is drawn. The same arguments give the same picture.

    **Arguments:**

    - `frame`: mip levels count as the nearest whole one.
    - `textures`: relative luminance, [y, x], by the frame's texture indices, whose
        sides are one power of two. >= 0.
    - `peak_luminance`: of the picture's white, beyond which light is cut off. [cd/m^2],
        > 0.

    **Returns:** for `Frame.previous_image`, sRGB-encoded. [1], in [0, 1].

    **Raises:** `ValueError` for a peak that is not > 0 and an index without texture.
    """
    if not peak_luminance > 0:
        raise ValueError(f"`peak_luminance` must be > 0 cd/m^2, got {peak_luminance}.")
    rows, columns = frame.shape
    texture, level = np.asarray(frame.texture), np.rint(np.asarray(frame.mip_level))
    if texture.max() >= len(textures):
        raise ValueError(
            f"`textures` must be one for every index to {texture.max()}, got "
            f"{len(textures)}."
        )
    light = np.empty((rows, TILE, columns, TILE))
    place = np.arange(TILE)
    for index, octaves in set(zip(texture.flat, level.flat, strict=True)):
        texels = _mip(textures[index] / np.mean(textures[index]), int(octaves))
        row, column = np.nonzero((texture == index) & (level == octaves))
        y = (row[:, None] * TILE + place) % len(texels)
        x = (column[:, None] * TILE + place) % len(texels)
        light[row, :, column] = texels[y[:, :, None], x[:, None]]
    light *= np.asarray(frame.luminance, float)[:, None, :, None] / peak_luminance
    grey = _encoded(np.minimum(light, 1.0)).reshape(rows * TILE, columns * TILE, 1)
    return np.repeat(grey, 3, axis=2)


def _mip(
    texture: Float[np.ndarray, "size size"], octaves: int
) -> Float[np.ndarray, "less less"]:
    """Means over squares of 2^octaves texels, the whole texture at most."""
    side = min(2**octaves, len(texture))
    count = len(texture) // side
    return texture.reshape(count, side, count, side).mean(axis=(1, 3))


def _encoded(light: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """sRGB values of light as a share of white's (IEC 61966-2-1)."""
    curve = 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, curve)


_GROUND, _WALL, _CROSSING, _SKY = range(4)
_EYE_HEIGHT_M, _STREET_HALF_WIDTH_M, _BUILDING_HEIGHT_M, _FAR_M = 1.6, 4.0, 7.0, 60.0


def _rays(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Tangents of the view rays, x to the right and y down, for square tiles."""
    step = 1.8 / columns
    x = (np.arange(columns) + 0.5 - columns / 2) * step
    y = (np.arange(rows) + 0.5 - 0.45 * rows) * step
    across, down = np.meshgrid(x, y)
    return across, down


def _street(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which surface each ray meets first, and how far along the view axis. [m]"""
    tiny = 1e-9
    ground = np.where(y > tiny, _EYE_HEIGHT_M / np.maximum(y, tiny), np.inf)
    wall = _STREET_HALF_WIDTH_M / np.maximum(np.abs(x), tiny)
    wall = np.where(-y * wall < _BUILDING_HEIGHT_M - _EYE_HEIGHT_M, wall, np.inf)
    distance = np.minimum(ground, wall)
    surface = np.where(ground <= wall, _GROUND, _WALL)
    surface = np.where(distance > _FAR_M, _SKY, surface)
    crossing = (np.abs(x + 0.25) < 0.09) & (-0.1 < y) & (y < _EYE_HEIGHT_M / 5)
    surface = np.where(crossing, _CROSSING, surface)
    distance = np.where(crossing, 5.0, np.minimum(distance, _FAR_M))
    return surface, distance


def _flow(
    x: np.ndarray,
    y: np.ndarray,
    surface: np.ndarray,
    distance: np.ndarray,
    *,
    turn: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Motion of what each ray meets, from walking pace and a turn of the head."""
    per_second = np.where(surface == _SKY, 0.0, 1.5 / distance)
    motion_x = np.degrees(x * per_second) - turn
    motion_x = motion_x + np.where(surface == _CROSSING, 30.0, 0.0)
    return motion_x, np.degrees(y * per_second)


def _light(
    x: np.ndarray,
    y: np.ndarray,
    surface: np.ndarray,
    distance: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Luminance: a lit and a shaded side, a bright sky, and patches of shadow."""
    lit = np.where(x > 0, 1.9, 0.7)
    log_light = np.select(
        [surface == _GROUND, surface == _WALL, surface == _CROSSING],
        [1.3 + 0.5 * np.tanh(4 * x), lit - 0.004 * distance, np.full_like(x, 1.6)],
        2.1 + 0.4 * np.clip(-y, 0, 1),
    )
    for _ in range(4):
        across, down, phase = rng.uniform([-6, -6, 0], [6, 6, 2 * np.pi])
        log_light = log_light + 0.15 * np.cos(across * x + down * y + phase)
    log_light = log_light - log_light.min()
    return 300 ** (log_light / max(log_light.max(), 1e-9))
