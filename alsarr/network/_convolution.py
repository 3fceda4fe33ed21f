"""Convolution of pictures whose channels come last."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def convolved(
    x: Float[Array, "batch height width in"],
    kernel: Float[Array, "high wide in out"],
    padding: int,
) -> Float[Array, "batch rows columns out"]:
    """Correlation, of pictures with so many rows and columns of zeros around them."""
    layout = ("NHWC", "HWIO", "NHWC")
    around = ((padding, padding), (padding, padding))
    # A GPU would otherwise round to ten bits.
    return jax.lax.conv_general_dilated(
        x, kernel, (1, 1), around, dimension_numbers=layout, precision="highest"
    )


def dense_kernel(
    weight: Float[Array, "out in_per_group 3 3"], groups: int
) -> Float[Array, "out in 3 3"]:
    """The kernels of a grouped convolution as those of an ordinary one, with zeros.

    XLA on a CPU is several times slower at grouped convolutions.
    """
    if groups == 1:
        return weight
    outs, ins = weight.shape[:2]
    own = jnp.eye(groups, dtype=weight.dtype)
    parts = weight.reshape(groups, outs // groups, 1, ins, 3, 3)
    return (parts * own[:, None, :, None, None, None]).reshape(outs, groups * ins, 3, 3)


def per_channel(values: Float[Array, " channels"]) -> Float[Array, "1 1 1 channels"]:
    """To be combined with pictures."""
    return values[None, None, None]
