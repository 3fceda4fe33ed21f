"""What training lowers, and the pass through the network that it differentiates."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._convolution import per_channel
from ._model import MetricNetwork
from ._transforms import AbstractTransform


Statistics = tuple[tuple[Array, Array], ...]
"""Mean and variance of each channel of each layer, rectified, over a batch."""


def adaptive_error(
    transform: AbstractTransform,
    target: Float[Array, "*n"],
    predicted: Float[Array, "*n"],
) -> Float[Array, ""]:
    """Mean absolute error in transformed space (Eq. 3). [1], in [0, 1]

    `target` is the metric in its own unit and `predicted` is in transformed space.
    """
    return jnp.mean(jnp.abs(transform(target) - predicted))


def training_pass(
    network: MetricNetwork, x: Float[Array, "batch channels height width"]
) -> tuple[Float[Array, "batch outputs rows columns"], Statistics]:
    """What a call gives for each picture, normalised by the statistics of the batch."""
    y, statistics = jnp.moveaxis(network.prepared(x), 1, -1), []
    for block in network.blocks:
        rectified = block.rectified(y)
        mean = jnp.mean(rectified, axis=(0, 1, 2))
        spread = rectified - per_channel(mean)
        variance = jnp.mean(spread * spread, axis=(0, 1, 2))
        statistics.append((mean, variance))
        y = block.finished(rectified, mean, variance)
    return jax.nn.sigmoid(jnp.moveaxis(y, -1, 1)), tuple(statistics)
