"""How much each input contributes: the paper's Table 1."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from ._evaluate import check_fits
from ._model import MetricNetwork
from ._samples import Samples


@dataclass(frozen=True)
class Attribution:
    """Shares of the inputs in what a network predicts.

    - `channels`: names.
    - `seen`, `unseen`: share of each channel in pixels that were seen in the previous
        picture, and in those that were not. [%], the sum is 100; NaN without pixels.
    """

    channels: tuple[str, ...]
    seen: tuple[float, ...]
    unseen: tuple[float, ...]


def attribute(
    network: MetricNetwork, samples: Samples, *, steps: int = 16
) -> Attribution:
    """Mean absolute contribution of each input channel, in per cent (Table 1).

    The paper has DeepLIFT's; these are integrated gradients, which need no rule for
    each kind of layer and add up as exactly: the contributions of all pixels and
    channels sum to what the picture's prediction differs from that of the baseline.
    The baseline is the mean of each channel over all samples, so that a mask of zeros
    says something, too. Where nothing was seen a reprojected channel has no value:
    its baseline is 0 there, as is its share.

    **Arguments:**

    - `network`: to be explained.
    - `samples`: of its metric, outputs and channels.
    - `steps`: of the integral, by the midpoint rule. > 0

    **Raises:** `ValueError` for samples that do not fit, or steps that are not > 0.

    **Source:** Sundararajan, Taly and Yan 2017, Axiomatic Attribution for Deep
    Networks, Eq. 1; Cardoso et al. 2022, Table 1.
    """
    if steps < 1:
        raise ValueError(f"`steps` must be > 0, got {steps}.")
    check_fits(network, samples)
    means = _means(network.channels, samples)
    total = np.zeros((2, len(network.channels)))
    for i in range(len(samples)):
        x = samples.picture(network.channels, i)
        seen = samples.picture(("seen",), i)[0] > 0.5
        baseline = _baseline(network.channels, means, seen)
        share = np.abs(integrated_gradients(network, x, baseline, steps=steps))
        total[0] += share[:, seen].sum(axis=1, dtype=np.float64)
        total[1] += share[:, ~seen].sum(axis=1, dtype=np.float64)
    sums = total.sum(axis=1, keepdims=True)
    percent = 100 * np.divide(total, sums, np.full_like(total, np.nan), where=sums > 0)
    seen_share, unseen_share = percent.tolist()
    return Attribution(network.channels, tuple(seen_share), tuple(unseen_share))


def integrated_gradients(
    network: MetricNetwork,
    x: Float32[np.ndarray, "channels height width"],
    baseline: Float32[np.ndarray, "channels height width"],
    *,
    steps: int,
) -> Float32[np.ndarray, "channels height width"]:
    """Contribution of each input to the sum of all predictions of a picture.

    It is (x - baseline) times the mean gradient on the straight way between them.
    """
    slope = np.zeros_like(x)
    for k in range(steps):
        way = np.float32((k + 0.5) / steps)
        point = jnp.asarray(baseline + way * (x - baseline))
        slope += np.asarray(_gradient(network, point))
    return (x - baseline) * slope / np.float32(steps)


@eqx.filter_jit
def _gradient(
    network: MetricNetwork, x: Float[Array, "channels height width"]
) -> Float[Array, "channels height width"]:
    return jax.grad(lambda z: jnp.sum(network(z)))(x)


def _means(channels: tuple[str, ...], samples: Samples) -> np.ndarray:
    sums = np.zeros(len(channels))
    for i in range(len(samples)):
        sums += samples.picture(channels, i).mean(axis=(1, 2), dtype=np.float64)
    return (sums / len(samples)).astype(np.float32)


def _baseline(
    channels: tuple[str, ...], means: np.ndarray, seen: np.ndarray
) -> np.ndarray:
    flat = [
        mean * seen if name.startswith("reprojected_") else np.full(seen.shape, mean)
        for name, mean in zip(channels, means, strict=True)
    ]
    return np.stack(flat).astype(np.float32)
