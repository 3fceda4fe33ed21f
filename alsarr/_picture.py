"""Pictures, sRGB-encoded: their light, and its means over tiles and coarse pixels."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check


def checked_picture(name: str, image: ArrayLike) -> Float[Array, "height width 3"]:
    """A picture as shares of white; integers count to the largest of their type.

    **Raises:** `ValueError` for another shape, or a value that is not in [0, 1]; under
    a JAX transformation values are checked at run time.
    """
    values = jnp.asarray(image)
    if values.ndim != 3 or values.shape[2] != 3 or values.size == 0:
        raise ValueError(
            f"`{name}` must have shape [height, width, 3], none of them 0, got "
            f"{values.shape}."
        )
    if jnp.issubdtype(values.dtype, jnp.integer):
        largest = jnp.iinfo(values.dtype).max
        values = values.astype(jnp.result_type(float)) / largest
    # Half precision is widened before anything is computed from it.
    values = jnp.asarray(values, jnp.result_type(float))
    return check(name, values, lambda x: (x >= 0) & (x <= 1), "in [0, 1]")


def decoded(image: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Light of sRGB values, as a share of white's (IEC 61966-2-1). [1]"""
    # XLA's own power takes several times as long on a CPU.
    curve = jnp.exp(2.4 * jnp.log((jnp.maximum(image, 0.04045) + 0.055) / 1.055))
    return jnp.where(image <= 0.04045, image / 12.92, curve)


def encoded(light: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The inverse of `decoded`."""
    curve = 1.055 * jnp.exp(jnp.log(jnp.maximum(light, 0.0031308)) / 2.4) - 0.055
    return jnp.where(light <= 0.0031308, light * 12.92, curve)


def block_means(
    light: Float[Array, "height width *channels"], high: int, wide: int
) -> Float[Array, "rows columns *channels"]:
    """Mean over blocks of `high` x `wide` pixels, from the top left.

    The last of a row or column has the pixels that exist.
    """
    sums = _block_sums(light, high, wide)
    ones = jnp.ones(light.shape[:2] + (1,) * (light.ndim - 2), light.dtype)
    return sums / _block_sums(ones, high, wide)


def _block_sums(values: Array, high: int, wide: int) -> Array:
    height, width, *channels = values.shape
    rows, columns = -(-height // high), -(-width // wide)
    missing = [(0, rows * high - height), (0, columns * wide - width)]
    padded = jnp.pad(values, missing + [(0, 0)] * len(channels))
    return padded.reshape(rows, high, columns, wide, *channels).sum(axis=(1, 3))
