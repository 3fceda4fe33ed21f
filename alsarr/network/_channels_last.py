"""Convolution and pooling with channels last, at which XLA is quicker on a CPU."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._model import ConvolutionBlock, dense_kernel


def kernel(block: ConvolutionBlock) -> Float[Array, "3 3 in out"]:
    """Kernels of an ordinary convolution, those of channels last."""
    return dense_kernel(block.weight, block.groups).transpose(2, 3, 1, 0)


def convolved(
    x: Float[Array, "batch height width in"],
    kernel: Float[Array, "high wide in out"],
    padding: int,
) -> Float[Array, "batch rows columns out"]:
    """Correlation, of pictures with so many rows and columns of zeros around them."""
    layout = ("NHWC", "HWIO", "NHWC")
    around = ((padding, padding), (padding, padding))
    return jax.lax.conv_general_dilated(
        x, kernel, (1, 1), around, dimension_numbers=layout
    )


def pooled(
    x: Float[Array, "batch height width channels"], size: int
) -> Float[Array, "batch rows columns channels"]:
    """Largest of each block of `size` x `size`, of which sizes are multiples."""
    for axis in (1, 2):
        parts = [
            jax.lax.slice_in_dim(x, i, None, stride=size, axis=axis)
            for i in range(size)
        ]
        x = parts[0]
        for part in parts[1:]:
            x = jnp.maximum(x, part)
    return x
