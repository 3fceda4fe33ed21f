"""The network of Cardoso et al. 2022: a metric of every tile before it is shaded."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._rates import RATES
from ._convolution import convolved, dense_kernel, per_channel
from ._pooling import max_pool, pad_to_regions, pool_sizes
from ._transforms import AbstractTransform


EPSILON = 1e-5
"""What is added to the variance in batch normalisation."""

DEFAULT_CHANNELS = ("reprojected_red", "seen", "diffuse_red", "normal_z")
"""The four inputs of Section 3.2, in the order of the released networks."""

DEFAULT_OUTPUTS = ("1x2", "2x1", "2x4", "4x2")
"""The four rates that Section 4.3 recommends; the others follow from them."""

_SEEN = "seen"
_REPROJECTED = "reprojected_"


class ConvolutionBlock(eqx.Module, strict=True):
    """3x3 convolution, rectifier, batch normalisation and max-pooling, in this order.

    Pictures have their channels last, at which XLA is quicker on a CPU.

    - `weight`: kernels, of the correlation that is called convolution here. [1]
    - `bias`: added to the convolution. [1]
    - `scale`, `shift`: of the normalised values (gamma and beta). [1]
    - `mean`, `variance`: of what is normalised, running means of training. [1],
      variance >= 0.
    - `groups`: of channels, each of which sees only its own inputs.
    - `pool`: width and height of what is pooled. [px]

    **Raises:** `ValueError` for groups that do not divide the channels.
    """

    weight: Float[Array, "out in_per_group 3 3"]
    bias: Float[Array, " out"]
    scale: Float[Array, " out"]
    shift: Float[Array, " out"]
    mean: Float[Array, " out"]
    variance: Float[Array, " out"]
    groups: int = eqx.field(static=True)
    pool: int = eqx.field(static=True)

    def __check_init__(self):
        if self.groups < 1 or self.weight.shape[0] % self.groups:
            raise ValueError(
                f"`groups` must divide the {self.weight.shape[0]} output channels, got "
                f"{self.groups}."
            )
        if self.pool < 1:
            raise ValueError(f"`pool` must be > 0 px, got {self.pool}.")

    @property
    def inputs(self) -> int:
        """Number of input channels."""
        return self.weight.shape[1] * self.groups

    @property
    def kernel(self) -> Float[Array, "3 3 in out"]:
        """Kernels of an ordinary convolution of pictures whose channels come last."""
        return dense_kernel(self.weight, self.groups).transpose(2, 3, 1, 0)

    def __call__(
        self, x: Float[Array, "batch height width in"]
    ) -> Float[Array, "batch rows columns out"]:
        """With the running statistics; sizes are multiples of `pool`."""
        return self.finished(self.rectified(x), self.mean, self.variance)

    def rectified(
        self, x: Float[Array, "batch height width in"]
    ) -> Float[Array, "batch height width out"]:
        """Convolution and rectifier."""
        return jax.nn.relu(convolved(x, self.kernel, 1) + per_channel(self.bias))

    def finished(
        self,
        rectified: Float[Array, "batch height width out"],
        mean: Float[Array, " out"],
        variance: Float[Array, " out"],
    ) -> Float[Array, "batch rows columns out"]:
        """Batch normalisation with these statistics, and pooling."""
        gain, shift = self.gain_and_shift(mean, variance)
        return max_pool(rectified * per_channel(gain) + per_channel(shift), self.pool)

    def gain_and_shift(
        self, mean: Float[Array, " out"], variance: Float[Array, " out"]
    ) -> tuple[Float[Array, " out"], Float[Array, " out"]]:
        """What batch normalisation with these statistics multiplies by and adds."""
        gain = self.scale * jax.lax.rsqrt(variance + EPSILON)
        return gain, self.shift - mean * gain


class MetricNetwork(eqx.Module, strict=True):
    """Predicts a metric of every region at several rates from what is known beforehand.

    - `blocks`: its layers.
    - `transform`: between what is predicted and the metric in its own unit.
    - `safety_offset`: added to what is predicted, in transformed space, by `predict`,
      against underestimation. [1], 0 for none.
    - `channels`: names of the inputs, of `alsarr.capture.CHANNELS`.
    - `outputs`: names of the rates that are predicted, of `alsarr.RATES` but 1x1.
    - `metric`: its name.
    - `ppd`: at which the metric was seen. [px/deg], > 0

    Everything is computed in the precision of the weights, float32 for a network that
    was trained or loaded. jit, vmap over pictures of one size, and grad go through it.

    **Raises:** `ValueError` for layers or names that do not fit together.

    **Source:** Cardoso et al. 2022, Sections 3.1 and 3.2 and Appendix B.
    """

    blocks: tuple[ConvolutionBlock, ...]
    transform: AbstractTransform
    safety_offset: Float[Array, ""]
    channels: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    metric: str = eqx.field(static=True)
    ppd: float = eqx.field(static=True)

    def __check_init__(self):
        if not 0 < self.ppd < math.inf:
            raise ValueError(f"`ppd` must be > 0 px/deg, got {self.ppd:g}.")
        _check_names(self.channels, self.outputs)
        counts = [len(self.channels)]
        for i, block in enumerate(self.blocks):
            if block.inputs != counts[-1]:
                raise ValueError(
                    f"`blocks[{i}]` must have {counts[-1]} input channels, got "
                    f"{block.inputs}."
                )
            counts.append(block.weight.shape[0])
        if len(counts) == 1 or counts[-1] != len(self.outputs):
            raise ValueError(
                f"`blocks` must end in {len(self.outputs)} channels, one for each of "
                f"`outputs`, got {counts[-1]}."
            )

    @property
    def region(self) -> int:
        """Width and height of what one output covers. [px]"""
        return math.prod(block.pool for block in self.blocks)

    def __call__(
        self, x: Float[Array, "channels height width"]
    ) -> Float[Array, "outputs rows columns"]:
        """Transformed metric of every region. [1], in [0, 1]

        **Arguments:**

        - `x`: inputs in the order of `channels`, as `View.channels` has them. What was
            reprojected counts only where "seen" is 1, if both are among them. Sizes
            need be no multiples of the region: see `pad_to_regions`.

        **Returns:** rates in the order of `outputs`; ceil(height / region) rows.

        **Raises:** `ValueError` for another number of channels.
        """
        y = jnp.moveaxis(self.prepared(x), 0, -1)[None]
        for block in self.blocks:
            y = block(y)
        return jax.nn.sigmoid(jnp.moveaxis(y[0], -1, 0))

    def predict(
        self, x: Float[Array, "channels height width"], *, safe: bool = True
    ) -> Float[Array, "outputs rows columns"]:
        """The metric in its own unit.

        **Arguments:**

        - `x`: as for a call.
        - `safe`: with the safety offset.

        **Returns:** T^-1 of what a call gives, the offset added and clipped to [0, 1].
        """
        return in_own_unit(self, self(x), safe)

    def prepared(
        self, x: Float[Array, "*batch channels height width"]
    ) -> Float[Array, "*batch channels high wide"]:
        """What the first layer sees: masked, padded, in the weights' precision."""
        if x.shape[-3] != len(self.channels):
            raise ValueError(
                f"`x` must have the {len(self.channels)} channels "
                f"{', '.join(self.channels)}, got {x.shape[-3]}."
            )
        x = x.astype(self.blocks[0].weight.dtype)
        return pad_to_regions(_masked(x, self.channels), self.region)


def in_own_unit(
    network: MetricNetwork,
    transformed: Float[Array, "outputs rows columns"],
    safe: bool,
) -> Float[Array, "outputs rows columns"]:
    """What `network.predict` makes of the outcome of a call."""
    if safe:
        transformed = transformed + network.safety_offset.astype(transformed.dtype)
    return network.transform.inverse(jnp.clip(transformed, 0.0, 1.0))


def initial_network(
    seed: int,
    *,
    metric: str,
    ppd: float,
    transform: AbstractTransform,
    channels: tuple[str, ...] = DEFAULT_CHANNELS,
    outputs: tuple[str, ...] = DEFAULT_OUTPUTS,
    region: int = 16,
    latent: int = 16,
    groups: tuple[int, ...] = (1, 1, 2, 4, 1),
) -> MetricNetwork:
    """An untrained network in float32.

    The biases of the last layer are 1 more than chance made them: an output has a
    single channel, and one that its rectifier stops in most places is learned badly or
    never comes back. What is added changes nothing else, for the normalisation that
    follows takes it away.

    **Arguments:**

    - `seed`: of the weights, which are uniform within 1/sqrt(inputs of a kernel).
    - `metric`: name of what it will predict.
    - `ppd`: at which that is seen. [px/deg], > 0
    - `transform`: of that metric.
    - `channels`, `outputs`: see `MetricNetwork`.
    - `region`: width and height of what one output covers. [px], > 0; see `pool_sizes`.
    - `latent`: channels between layers. > 0. The paper found less than 16 to cost
      quality, and 8 to be the least.
    - `groups`: of each layer, as many as there are layers. The default is that of the
      released networks for one metric; Table 3 prints (1, 1, 4, 8, 1), and the released
      network of six layers has (1, 1, 2, 4, 8, 1).

    **Raises:** `ValueError` for groups that do not divide the channels.

    **Source:** Cardoso et al. 2022, Appendix B.
    """
    counts = [len(channels), *[latent] * (len(groups) - 1), len(outputs)]
    random = np.random.default_rng(seed)
    blocks = []
    for i, pool in enumerate(pool_sizes(region, len(groups))):
        ins, outs = counts[i : i + 2]
        if groups[i] < 1 or ins % groups[i] or outs % groups[i]:
            raise ValueError(
                f"`groups[{i}]` must divide {ins} and {outs} channels, got {groups[i]}."
            )
        shape = (outs, ins // groups[i], 3, 3)
        bound = math.prod(shape[1:]) ** -0.5
        raised = 1.0 if i == len(groups) - 1 else 0.0
        blocks.append(
            ConvolutionBlock(
                weight=_uniform(random, shape, bound),
                bias=_uniform(random, (outs,), bound) + raised,
                scale=jnp.ones(outs, jnp.float32),
                shift=jnp.zeros(outs, jnp.float32),
                mean=jnp.zeros(outs, jnp.float32),
                variance=jnp.ones(outs, jnp.float32),
                groups=groups[i],
                pool=pool,
            )
        )
    return MetricNetwork(
        blocks=tuple(blocks),
        transform=transform,
        safety_offset=jnp.zeros((), jnp.float32),
        channels=channels,
        outputs=outputs,
        metric=metric,
        ppd=ppd,
    )


def _uniform(
    random: np.random.Generator, shape: tuple[int, ...], bound: float
) -> Array:
    return jnp.asarray(random.uniform(-bound, bound, shape), jnp.float32)


def _masked(
    x: Float[Array, "*batch channels height width"], channels: tuple[str, ...]
) -> Float[Array, "*batch channels height width"]:
    """What was reprojected is 0 where it was not seen."""
    if _SEEN not in channels:
        return x
    seen = x[..., channels.index(_SEEN), :, :]
    parts = [
        x[..., i, :, :] * seen if name.startswith(_REPROJECTED) else x[..., i, :, :]
        for i, name in enumerate(channels)
    ]
    return jnp.stack(parts, axis=-3)


def _check_names(channels: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    if not channels or len(set(channels)) < len(channels):
        raise ValueError(f"`channels` must be names, each once, got {channels}.")
    rates = RATES.names[:-1]
    if not outputs or len(set(outputs)) < len(outputs) or not set(outputs) <= {*rates}:
        raise ValueError(
            f"`outputs` must be some of {', '.join(rates)}, each once, got {outputs}."
        )
