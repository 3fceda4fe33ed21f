"""What moves: parts of a scene with what hangs on them, and the camera."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Float32, Int32

from camojab._errors import check

from ._camera import Camera
from ._numbers import Numbers


class Pose(eqx.Module, strict=True):
    """Where each part is at one moment; entry 0 is what stands still.

    A point x of a part goes to turn (x - pivot) + pivot + shift.
    """

    pivot: Float32[Array, "poses 3"]
    turn: Float32[Array, "poses 3 3"]
    shift: Float32[Array, "poses 3"]

    @jax.jit
    def points(
        self, place: Float32[Array, "n 3"], part: Int32[Array, " n"]
    ) -> Float32[Array, "n 3"]:
        """Points [m] of the given parts, moved."""
        pivot = self.pivot[part]
        return self.directions(place - pivot, part) + pivot + self.shift[part]

    @jax.jit
    def directions(
        self, direction: Float32[Array, "n 3"], part: Int32[Array, " n"]
    ) -> Float32[Array, "n 3"]:
        """Directions of the given parts, turned."""
        # A matrix product would be rounded to fewer digits on some accelerators.
        return jnp.sum(self.turn[part] * direction[:, None, :], axis=-1)


class Animation(eqx.Module, strict=True):
    """Keyframed motion of a scene's parts, repeated for ever.

    Between two keys, translations and rotation vectors are interpolated linearly, which
    is a turn at constant speed about the axis where the axis does not change.

    **Arguments:**

    - `time`: of the keys, from 0, increasing; the last is the period, after which
        everything starts again. At least two. [s]
    - `pivot`: the point that each part turns about. [m]
    - `translation`: of each part at each key. [m]
    - `rotation`: axis times angle, right-handed, of each part at each key; more than
        one whole turn is allowed. [rad]
    - `light_part`: which part each point light of the scene hangs on, 0 for none.

    **Raises:** `ValueError` for shapes or values out of range.
    """

    time: Float32[Array, " keys"]
    pivot: Float32[Array, "parts 3"]
    translation: Float32[Array, "parts keys 3"]
    rotation: Float32[Array, "parts keys 3"]
    light_part: Int32[Array, " points"]

    def __init__(
        self,
        time: Numbers,
        pivot: Numbers,
        translation: Numbers,
        rotation: Numbers,
        light_part: Numbers = (),
    ):
        self.time = _keys(time)
        if float(self.time[0]) != 0:
            raise ValueError(f"`time` must start at 0 s, got {float(self.time[0]):g}.")
        self.pivot = _finite("pivot", pivot)
        self.translation = _finite("translation", translation)
        self.rotation = _finite("rotation", rotation)
        shape = (len(self.pivot), len(self.time), 3)
        for name, value in (
            ("translation", self.translation),
            ("rotation", self.rotation),
        ):
            if value.shape != shape:
                raise ValueError(
                    f"`{name}` must have shape {shape}, got {value.shape}."
                )
        light = np.asarray(light_part, np.int32)
        if light.size and not (0 <= light.min() and light.max() <= len(self.pivot)):
            raise ValueError(
                f"`light_part` must be in [0, {len(self.pivot)}], got {light.min()} to "
                f"{light.max()}."
            )
        self.light_part = jnp.asarray(light)

    def pose(self, time: ArrayLike) -> Pose:
        """Where the parts are at `time` [s], finite."""
        now = check("time", jnp.asarray(time, jnp.float32), jnp.isfinite, "finite")
        return _pose(self, now)


class CameraPath(eqx.Module, strict=True):
    """A camera that moves smoothly through keyframes; see `camera_path`."""

    time: Float32[Array, " keys"]
    value: Float32[Array, "keys 10"]
    slope: Float32[Array, "keys 10"]

    def at(self, time: ArrayLike) -> Camera:
        """The camera at `time` [s], finite; before and after all keys it stands."""
        now = check("time", jnp.asarray(time, jnp.float32), jnp.isfinite, "finite")
        value = _hermite(self, now)
        return Camera(value[0:3], value[3:6], value[6:9], fov_y=value[9])


def camera_path(time: Numbers, cameras: Sequence[Camera]) -> CameraPath:
    """A smooth path through cameras: at each key, the camera given for it.

    Position, view axis, up and angle of view follow cubic Hermite curves whose slope at
    a key is that from its neighbour to its neighbour (Catmull and Rom 1974, with the
    keys' own times), so speed and turning rate are continuous.

    **Arguments:**

    - `time`: of the keys, increasing; at least two. [s]
    - `cameras`: one for each key. View axes of neighbours should be less than 90
        degrees apart; 180 degrees cannot be interpolated.

    **Raises:** `ValueError` for times out of order or another number of cameras.
    """
    keys = _keys(time)
    if len(cameras) != len(keys):
        raise ValueError(
            f"`cameras` must be one for each of {len(keys)} times, got {len(cameras)}."
        )
    value = np.stack(
        [
            np.concatenate([c.position, c.forward, c.up, np.reshape(c.fov_y, 1)])
            for c in cameras
        ]
    )
    moment = np.asarray(keys)
    before = np.maximum(np.arange(len(moment)) - 1, 0)
    after = np.minimum(np.arange(len(moment)) + 1, len(moment) - 1)
    slope = (value[after] - value[before]) / (moment[after] - moment[before])[:, None]
    return CameraPath(keys, jnp.asarray(value), jnp.asarray(slope))


def _keys(time: Numbers) -> Float32[Array, " keys"]:
    moment = np.asarray(time, np.float32)
    rising = moment.ndim == 1 and len(moment) >= 2 and bool(np.all(np.diff(moment) > 0))
    if not rising or not np.all(np.isfinite(moment)):
        raise ValueError(
            f"`time` must be at least two increasing, finite times in s, got {time}."
        )
    return jnp.asarray(moment)


def _finite(name: str, value: Numbers) -> Float32[Array, "..."]:
    return check(name, jnp.asarray(value, jnp.float32), jnp.isfinite, "finite")


# Step by step, each of these would be a dozen compilations instead of one.
@jax.jit
def _pose(animation: Animation, now: Float[Array, ""]) -> Pose:
    now = now % animation.time[-1]
    shift = _linear(now, animation.time, animation.translation)
    turn = jax.vmap(_matrix)(_linear(now, animation.time, animation.rotation))
    still = jnp.zeros((1, 3), jnp.float32)
    return Pose(
        pivot=jnp.concatenate([still, animation.pivot]),
        turn=jnp.concatenate([jnp.eye(3, dtype=jnp.float32)[None], turn]),
        shift=jnp.concatenate([still, shift]),
    )


@jax.jit
def _hermite(path: CameraPath, now: Float[Array, ""]) -> Float[Array, "10"]:
    now = jnp.clip(now, path.time[0], path.time[-1])
    after = jnp.clip(jnp.searchsorted(path.time, now), 1, len(path.time) - 1)
    step = path.time[after] - path.time[after - 1]
    s = (now - path.time[after - 1]) / step
    return (
        (1 + 2 * s) * (1 - s) ** 2 * path.value[after - 1]
        + s**2 * (3 - 2 * s) * path.value[after]
        + step * s * (1 - s) ** 2 * path.slope[after - 1]
        - step * s**2 * (1 - s) * path.slope[after]
    )


def _linear(
    now: Float[Array, ""],
    time: Float[Array, " keys"],
    value: Float[Array, "parts keys 3"],
) -> Float[Array, "parts 3"]:
    after = jnp.clip(jnp.searchsorted(time, now, side="right"), 1, len(time) - 1)
    s = (now - time[after - 1]) / (time[after] - time[after - 1])
    return (1 - s) * value[:, after - 1] + s * value[:, after]


def _matrix(rotation: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The matrix of a rotation vector (Rodrigues)."""
    angle = jnp.sqrt(jnp.sum(rotation**2))
    x, y, z = rotation / jnp.where(angle > 0, angle, 1)
    zero = jnp.zeros((), rotation.dtype)
    cross = jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
    eye = jnp.eye(3, dtype=rotation.dtype)
    axis = jnp.stack([x, y, z])
    outer = axis[:, None] * axis[None, :]
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    return cosine * eye + sine * cross + (1 - cosine) * outer
