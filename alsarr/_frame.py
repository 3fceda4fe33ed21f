"""A G-buffer at tile resolution: what is seen in each 16x16 tile, and how it moves."""

import zipfile
from pathlib import Path
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from camojab._errors import check
from camojab._files import DAMAGED, replacing


class Frame(eqx.Module, strict=True):
    """One frame of the renderer's auxiliary buffers, one value a tile.

    All arrays have the shape `[rows, columns]` of the rate map, the top row first.
    Wherever tiles are numbered, they are numbered row by row.

    **Arguments:**

    - `texture`: index of the texture that the tile shows. Whole numbers, >= 0.
    - `mip_level`: level at which full-rate shading samples it. [octaves], >= 0.
    - `velocity_x`, `velocity_y`: slowest motion in the tile along each axis (the
        conservative choice of Jindal et al. 2021, Eq. 28). [deg/s], >= 0. A single
        number stands for every tile.
    - `luminance`: mean luminance of the tile. [cd/m^2], >= 0. A single number stands
        for every tile.

    **Raises:** `ValueError` for a shape that differs from that of `texture`, a texture
    index that is no whole number, and a value that is negative or not finite; under a
    JAX transformation bad values are raised at run time in the same words.
    """

    texture: Int[Array, "rows columns"]
    mip_level: Float[Array, "rows columns"]
    velocity_x: Float[Array, "rows columns"]
    velocity_y: Float[Array, "rows columns"]
    luminance: Float[Array, "rows columns"]

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
        luminance: ArrayLike,
    ):
        self.texture = _texture_index(texture)
        shape = self.texture.shape
        self.mip_level = _per_tile("mip_level", mip_level, shape)
        self.velocity_x = _per_tile("velocity_x", velocity_x, shape)
        self.velocity_y = _per_tile("velocity_y", velocity_y, shape)
        self.luminance = _per_tile("luminance", luminance, shape)

    @classmethod
    def from_degrees(
        cls,
        *,
        texture: ArrayLike,
        mip_level: ArrayLike,
        motion_x: ArrayLike,
        motion_y: ArrayLike,
        luminance: ArrayLike,
    ) -> "Frame":
        """From signed motion in degrees per second; only its magnitude is kept."""
        return cls(
            texture=texture,
            mip_level=mip_level,
            velocity_x=jnp.abs(jnp.asarray(motion_x)),
            velocity_y=jnp.abs(jnp.asarray(motion_y)),
            luminance=luminance,
        )

    @classmethod
    def from_pixels_per_frame(
        cls,
        *,
        texture: ArrayLike,
        mip_level: ArrayLike,
        motion_x: ArrayLike,
        motion_y: ArrayLike,
        luminance: ArrayLike,
        ppd: ArrayLike,
        refresh_rate: ArrayLike,
    ) -> "Frame":
        """From motion vectors in pixels per frame; only their magnitude is kept.

        `refresh_rate` [Hz] is the rate at which those frames follow one another, `ppd`
        [px/deg] belongs to the full-resolution pixels that the vectors count.
        """
        rate = check("refresh_rate", refresh_rate, _positive, "> 0 Hz and finite")
        density = check("ppd", ppd, _positive, "> 0 px/deg and finite")
        speed = _default_float(rate) / _default_float(density)
        return cls.from_degrees(
            texture=texture,
            mip_level=mip_level,
            motion_x=_default_float(motion_x) * speed,
            motion_y=_default_float(motion_y) * speed,
            luminance=luminance,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the rate map."""
        rows, columns = self.texture.shape
        return rows, columns


def frame_from_jindal2021(
    *,
    motion_x: ArrayLike,
    motion_y: ArrayLike,
    material: ArrayLike,
    mip_level: ArrayLike,
    ppd: ArrayLike = 60.0,
    refresh_rate: ArrayLike = 60.0,
    resolution_px: tuple[int, int] = (1920, 1080),
    luminance: ArrayLike = 50.0,
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
        motion_x=_default_float(motion_x) * (width / 100),
        motion_y=_default_float(motion_y) * (height / 100),
        luminance=luminance,
        ppd=ppd,
        refresh_rate=refresh_rate,
    )


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


def save_frame(path: str | Path, frame: Frame) -> None:
    """Write a frame as an NPZ file, one array a field. Written whole or not at all."""
    arrays: dict[str, Any] = {n: np.asarray(getattr(frame, n)) for n in Frame.UNITS}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_frame(path: str | Path) -> Frame:
    """Read a frame that `save_frame` wrote, or any NPZ file with the same arrays.

    **Raises:** `ValueError` naming the file if it is no NPZ file or lacks an array;
    `FileNotFoundError`; and as `Frame`. Nothing in the file is executed.
    """
    with Path(path).open("rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError(f"{path}: is no NPZ file.")
        try:
            stored = np.load(file, allow_pickle=False)
            missing = [name for name in Frame.UNITS if name not in stored.files]
            arrays = {name: stored[name] for name in Frame.UNITS if not missing}
        except DAMAGED as error:
            raise ValueError(
                f"{path}: holds something else than whole, plain arrays."
            ) from error
    if missing:
        raise ValueError(f"{path}: lacks the arrays {', '.join(missing)}.")
    return Frame(**arrays)


def _positive(x: Array) -> Array:
    return (x > 0) & jnp.isfinite(x)


def _default_float(x: ArrayLike) -> Array:
    """Half-precision buffers are widened before anything is computed from them."""
    return jnp.asarray(x, jnp.result_type(float))


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
