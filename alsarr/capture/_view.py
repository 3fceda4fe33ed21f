"""One viewpoint's record: its G-buffer, its pictures at every rate, and its past."""

import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float16, Float32, Int, Int32, UInt8, UInt16

from camojab._files import DAMAGED, replacing

from .._frame import Frame, tile_luminance
from .._rates import RATES, TILE
from ._camera import Camera


CHANNELS = (
    *("reprojected_red", "reprojected_green", "reprojected_blue", "seen"),
    *("diffuse_red", "diffuse_green", "diffuse_blue"),
    *("specular_red", "specular_green", "specular_blue", "roughness"),
    *("normal_x", "normal_y", "normal_z", "shadow", "reflect"),
)
"""What a predictor may look at before anything is shaded."""

_COLOURS = ("red", "green", "blue")
_AXES = ("x", "y", "z")
_FULL = RATES.names.index("1x1")
_CAMERAS = ("camera", "previous_camera")
_OF_CAMERA = ("position", "forward", "up", "fov_y")
_SCHEMA = "alsarr-view/1"
# Not `uv`, which are as a scene's file has them.
_FINITE = ("depth", "normal", "mip_level", "motion", "exposure", "time")
# Of all arrays as they are, before they are packed.
_BYTES_PER_PIXEL, _BYTES_OF_HEADERS = 3 * len(RATES) + 43, 16384


class View(eqx.Module, strict=True):
    """What one viewpoint shows, as arrays on the host, the top row of pixels first.

    - `images`: the picture at each of `RATES`, in their order, so the last is shaded
        at full rate. sRGB bytes, all of the same `exposure`.
    - `normal`: of the surface, in view space: x right, y up, z towards the viewer.
        Unit, 0 where the sky is.
    - `diffuse`, `specular`: albedo, and reflectance at normal incidence. sRGB bytes.
    - `roughness`: perceptual. Bytes for [0, 1].
    - `depth`: along the view axis. [m], infinite for the sky.
    - `uv`: texture coordinates, v down. [1]
    - `texture`: index of the colour texture; 0 where there is none, or the sky.
    - `mip_level`: that full-rate shading reads the colour texture at. [octaves], >= 0
    - `shadow`: 255 where the sun reaches, 0 elsewhere and for the sky.
    - `motion`: from the previous frame to this one, x right and y down. [px]
    - `reprojected`: the previous viewpoint's picture, moved to where its points are
        now. sRGB bytes, 0 where nothing was seen.
    - `seen`: whether the previous picture shows the same point.
    - `invocations`: shading samples of each of `RATES`; the sky counts.
    - `exposure`: what light was multiplied by before the tone curve.
    - `time`: of the scene. [s]
    - `camera`, `previous_camera`: of this frame and the one before.
    - `scene`: its name.
    """

    images: UInt8[np.ndarray, "rates height width 3"]
    normal: Float16[np.ndarray, "height width 3"]
    diffuse: UInt8[np.ndarray, "height width 3"]
    specular: UInt8[np.ndarray, "height width 3"]
    roughness: UInt8[np.ndarray, "height width"]
    depth: Float32[np.ndarray, "height width"]
    uv: Float32[np.ndarray, "height width 2"]
    texture: UInt16[np.ndarray, "height width"]
    mip_level: Float16[np.ndarray, "height width"]
    shadow: UInt8[np.ndarray, "height width"]
    motion: Float32[np.ndarray, "height width 2"]
    reprojected: UInt8[np.ndarray, "height width 3"]
    seen: Bool[np.ndarray, "height width"]
    invocations: Int32[np.ndarray, " rates"]
    exposure: Float32[np.ndarray, ""]
    time: Float32[np.ndarray, ""]
    camera: Camera
    previous_camera: Camera
    scene: str = eqx.field(static=True)

    ARRAYS: ClassVar[dict[str, str]] = {
        "images": "uint8",
        "normal": "float16",
        "diffuse": "uint8",
        "specular": "uint8",
        "roughness": "uint8",
        "depth": "float32",
        "uv": "float32",
        "texture": "uint16",
        "mip_level": "float16",
        "shadow": "uint8",
        "motion": "float32",
        "reprojected": "uint8",
        "seen": "bool",
        "invocations": "int32",
        "exposure": "float32",
        "time": "float32",
    }

    @property
    def size(self) -> tuple[int, int]:
        """Width and height. [px]"""
        height, width = self.depth.shape
        return width, height

    @property
    def reference(self) -> UInt8[np.ndarray, "height width 3"]:
        """The picture shaded at full rate."""
        return self.images[_FULL]

    def shaded(
        self, rate: Int[np.ndarray, "rows columns"]
    ) -> UInt8[np.ndarray, "height width 3"]:
        """The picture with each tile as it was shaded at its rate. sRGB bytes.

        **Arguments:**

        - `rate`: of each tile of 16x16 pixels, as an index into `RATES`.

        **Raises:** `ValueError` for another number of tiles, or an index out of range.
        """
        width, height = self.size
        tiles = -(-height // TILE), -(-width // TILE)
        if rate.shape != tiles:
            raise ValueError(
                f"`rate` must have shape {list(tiles)}, one for each tile, got "
                f"{list(rate.shape)}."
            )
        if not 0 <= rate.min() <= rate.max() < len(RATES):
            raise ValueError(
                f"`rate` must be in [0, {len(RATES)}), got {rate.min()} to "
                f"{rate.max()}."
            )
        pixel = rate.repeat(TILE, axis=0).repeat(TILE, axis=1)[:height, :width]
        return np.take_along_axis(self.images, pixel[None, ..., None], axis=0)[0]

    def channels(
        self, names: Sequence[str] = CHANNELS
    ) -> dict[str, Float32[np.ndarray, "height width"]]:
        """What is known of every pixel before it is shaded.

        **Arguments:**

        - `names`: of `CHANNELS`.

        **Returns:** by name, in the order of `names`. Colours, sRGB-encoded, roughness,
        shadow and `seen` in [0, 1]; `normal_x`, `normal_y` and `normal_z` in [-1, 1];
        `reflect`, the cosine between normal and viewer, in [0, 1].

        **Raises:** `ValueError` for a name that is none.
        """
        unknown = [name for name in names if name not in CHANNELS]
        if unknown:
            raise ValueError(
                f"`names` must be of {', '.join(CHANNELS)}, got {unknown[0]!r}."
            )
        return {name: self._channel(name) for name in names}

    def frame(
        self,
        *,
        ppd: float | int,
        refresh_rate: float | int,
        peak_luminance: float | int,
    ) -> Frame:
        """The same at tile resolution, for the controller and every oracle.

        A tile has the texture that most of its pixels show (of equally many the first),
        the mean mip level of the pixels that show it, and on each axis the slowest
        motion of its pixels (Jindal et al. 2021, Eq. 28). Luminance is that of the
        full-rate picture. `previous_image` is the reprojected picture, black where
        nothing was seen, and `channels` has all of `CHANNELS`.

        **Arguments:**

        - `ppd`: of the display. [px/deg], > 0
        - `refresh_rate`: at which the previous frame and this one follow each other.
            [Hz], > 0
        - `peak_luminance`: of the display's white. [cd/m^2], > 0

        **Raises:** `ValueError` as `Frame` and `tile_luminance`.
        """
        texture, mip_level = _dominant(self.texture, self.mip_level.astype(np.float32))
        slowest = _tiles(np.abs(self.motion), np.inf).min(axis=2)
        return Frame.from_pixels_per_frame(
            texture=texture,
            mip_level=mip_level,
            motion_x=slowest[..., 0],
            motion_y=slowest[..., 1],
            ppd=ppd,
            refresh_rate=refresh_rate,
            luminance=tile_luminance(self.reference, peak_luminance),
            previous_image=self.reprojected,
            channels=self.channels(),
        )

    def _channel(self, name: str) -> Float32[np.ndarray, "height width"]:
        if name == "reflect":
            return self._facing()
        field, _, part = name.partition("_")
        values = getattr(self, field)
        if part:
            values = values[..., (_AXES if field == "normal" else _COLOURS).index(part)]
        largest = 255 if values.dtype == np.uint8 else 1
        return values.astype(np.float32) / np.float32(largest)

    def _facing(self) -> Float32[np.ndarray, "height width"]:
        """Cosine between the normal and the direction to the viewer, 0 for the sky."""
        width, height = self.size
        y, x = np.mgrid[:height, :width].astype(np.float32) + np.float32(0.5)
        rays = self.camera.rays(jnp.asarray(x), jnp.asarray(y), width, height)
        normal = self.normal.astype(np.float32)
        axes = np.stack([self.camera.right, self.camera.up, -self.camera.forward])
        view = -np.asarray(rays) @ axes.T
        return np.clip(np.sum(normal * view, axis=2), 0, 1)


def save_view(path: str | Path, view: View) -> None:
    """Write a view as an NPZ file, one array a field. Written whole or not at all."""
    arrays: dict[str, Any] = {name: getattr(view, name) for name in View.ARRAYS}
    for camera in _CAMERAS:
        for name in _OF_CAMERA:
            value = getattr(getattr(view, camera), name)
            arrays[f"{camera}_{name}"] = np.asarray(value)
    arrays |= {"schema": np.asarray(_SCHEMA), "scene": np.asarray(view.scene)}
    # The fastest level takes a third of the time of NumPy's own for a tenth more bytes.
    packing: dict[str, Any] = {"compression": zipfile.ZIP_DEFLATED, "compresslevel": 1}
    with (
        replacing(path) as temporary,
        zipfile.ZipFile(temporary, "w", **packing) as archive,
    ):
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)


def load_view(path: str | Path) -> View:
    """Read a view that `save_view` wrote.

    **Raises:** `ValueError` naming the file if it is not whole or of another kind, or
    if an array or a camera is missing, of another shape or out of range;
    `FileNotFoundError`. Nothing in the file is executed.
    """
    with Path(path).open("rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError(f"{path}: is no NPZ file.")
        try:
            with np.load(file, allow_pickle=False) as stored:
                found = {name: stored[name] for name in stored.files}
        except DAMAGED as error:
            raise ValueError(
                f"{path}: holds something else than whole, plain arrays."
            ) from error
    _check(path, found)
    fields: dict[str, Any] = {name: found[name] for name in View.ARRAYS}
    for camera in _CAMERAS:
        given = {name: found[f"{camera}_{name}"] for name in _OF_CAMERA}
        try:
            fields[camera] = Camera(**given)
        except ValueError as error:
            raise ValueError(f"{path}: {camera}: {error}") from error
    return View(**fields, scene=str(found["scene"]))


def _check(path: str | Path, found: dict[str, np.ndarray]) -> None:
    """Whether arrays are those of one view: all there, of their kind, and as large."""
    if str(found.get("schema")) != _SCHEMA:
        raise ValueError(f"{path}: must be a view with schema {_SCHEMA}.")
    cameras = {f"{c}_{name}": name for c in _CAMERAS for name in _OF_CAMERA}
    missing = [n for n in (*View.ARRAYS, *cameras, "scene") if n not in found]
    if missing:
        raise ValueError(f"{path}: lacks the arrays {', '.join(missing)}.")
    size = found["depth"].shape
    if len(size) != 2 or 0 in size:
        raise ValueError(
            f"{path}: `depth` must have shape [height, width], none of them 0, got "
            f"{list(size)}."
        )
    shapes = {"images": (len(RATES), *size, 3), "uv": (*size, 2), "motion": (*size, 2)}
    shapes |= {n: (*size, 3) for n in ("normal", "diffuse", "specular", "reprojected")}
    shapes |= {"invocations": (len(RATES),), "exposure": (), "time": ()}
    shapes |= {name: () if part == "fov_y" else (3,) for name, part in cameras.items()}
    for name, dtype in (View.ARRAYS | dict.fromkeys(cameras, "float32")).items():
        array, shape = found[name], shapes.get(name, size)
        if array.shape != shape:
            raise ValueError(
                f"{path}: `{name}` must have shape {list(shape)}, got "
                f"{list(array.shape)}."
            )
        if array.dtype != np.dtype(dtype):
            raise ValueError(f"{path}: `{name}` must be {dtype}, got {array.dtype}.")
    for name in _FINITE:
        _check_numbers(path, name, found[name])


def _check_numbers(path: str | Path, name: str, array: np.ndarray) -> None:
    """Finite ones, but for the depth of the sky."""
    sky = name == "depth"
    wrong = array[~((array > -np.inf) if sky else np.isfinite(array))]
    if wrong.size:
        rule = "finite, or inf for the sky" if sky else "finite"
        raise ValueError(f"{path}: `{name}` must be {rule}, got {wrong[0]}.")


def most_bytes(size: tuple[int, int]) -> int:
    """What a view of a size takes in a file at the most. [bytes]

    **Arguments:**

    - `size`: width and height. [px]
    """
    return size[0] * size[1] * _BYTES_PER_PIXEL + _BYTES_OF_HEADERS


def view_path(folder: str | Path, index: int) -> Path:
    """Where the view of a number is in a capture folder."""
    return Path(folder) / f"view_{index:05d}.npz"


def views(folder: str | Path) -> list[Path]:
    """The views of a capture folder, by their numbers.

    **Raises:** `ValueError` if there is none.
    """
    found = sorted(Path(folder).glob("view_*.npz"))
    if not found:
        raise ValueError(f"{folder}: must be a folder with views, has none.")
    return found


def _tiles(values: np.ndarray, fill: float | int) -> np.ndarray:
    """Pixels by tile, [row, column, pixel, ...], with `fill` beyond the edge."""
    height, width, *channels = values.shape
    missing = [(0, -height % TILE), (0, -width % TILE)] + [(0, 0)] * len(channels)
    padded = np.pad(values, missing, constant_values=fill)
    rows, columns = padded.shape[0] // TILE, padded.shape[1] // TILE
    grid = padded.reshape(rows, TILE, columns, TILE, *channels).swapaxes(1, 2)
    return grid.reshape(rows, columns, TILE**2, *channels)


def _dominant(
    texture: UInt16[np.ndarray, "height width"],
    mip_level: Float32[np.ndarray, "height width"],
) -> tuple[Int[np.ndarray, "rows columns"], Float32[np.ndarray, "rows columns"]]:
    """The texture that most pixels of each tile show, and their mean mip level."""
    index = _tiles(texture.astype(np.int32), -1)
    level = _tiles(mip_level, 0)
    votes = np.sum(index[..., :, None] == index[..., None, :], axis=-1)
    votes = np.where(index >= 0, votes, 0)
    # Textures are compared in the order of their index, whatever the pixels' order.
    most = np.where(
        votes == votes.max(axis=-1, keepdims=True), index, np.iinfo("i4").max
    )
    chosen = most.min(axis=-1)
    shown = index == chosen[..., None]
    mean = np.sum(level * shown, axis=-1) / np.sum(shown, axis=-1)
    return chosen, mean.astype(np.float32)
