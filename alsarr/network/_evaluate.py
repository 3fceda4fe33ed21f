"""How well a network predicts: the columns of the paper's Table 2, and the offset."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from ._model import MetricNetwork
from ._samples import Samples


@dataclass(frozen=True)
class Score:
    """Agreement of predictions with the metric, both in transformed space.

    - `output`: name of the rate, or "all" for the tiles of all rates taken together,
        about their common mean.
    - `tiles`: "seen" (at least half of the pixels were seen in the previous picture),
        "unseen" or "all".
    - `count`: of what is compared.
    - `r2`: coefficient of determination, 1 - sum e^2 / sum (T - mean T)^2. [1], <= 1;
        NaN where T does not vary.
    - `mae`: mean of |e|. [1], in [0, 1]
    - `mae_under`: what underestimation contributes to it: the sum of |e| over the tiles
        that were underestimated, divided by the number of all. With what overestimation
        contributes it makes `mae`, and it is the safety offset. [1]
    - `sigma`: standard deviation of |e|. [1]

    All but `count` are NaN where there are no tiles.
    """

    output: str
    tiles: str
    count: int
    r2: float
    mae: float
    mae_under: float
    sigma: float


def evaluate(
    network: MetricNetwork, samples: Samples, *, safe: bool = False
) -> tuple[Score, ...]:
    """The columns of Table 2 on some samples.

    The numbers are in transformed space: the paper's do not say so, but an error of
    0.03 could not be one of PSNR in dB. Use `Samples.of_scene` for one scene at a time.

    **Arguments:**

    - `network`: to be judged.
    - `samples`: that it has not learned from, of its metric and outputs.
    - `safe`: with the safety offset.

    **Returns:** one `Score` for all outputs together and for each, in each case for all
    tiles, seen ones and unseen ones.

    **Raises:** `ValueError` for samples that lack an input, or of another metric or
    other outputs.

    **Source:** Cardoso et al. 2022, Section 5.1.
    """
    target, predicted = _compared(network, samples)
    if safe:
        offset = np.float32(network.safety_offset)
        predicted = np.clip(predicted + offset, 0.0, 1.0)
    everywhere = np.ones_like(samples.seen)
    regions = {"all": everywhere, "seen": samples.seen, "unseen": ~samples.seen}
    scores = []
    for i, output in enumerate(("all", *network.outputs)):
        chosen = slice(None) if i == 0 else slice(i - 1, i)
        for tiles, mask in regions.items():
            pick = lambda x, c=chosen, m=mask: np.moveaxis(x[:, c], 1, -1)[m].ravel()
            scores.append(_score(output, tiles, pick(target), pick(predicted)))
    return tuple(scores)


def score_table(scores: Sequence[Score]) -> str:
    """Scores as lines of text, a heading first."""
    lines = ["output  tiles    count     R2     MAE   under   sigma"]
    for s in scores:
        numbers = f"{s.r2:6.3f} {s.mae:7.4f} {s.mae_under:7.4f} {s.sigma:7.4f}"
        lines.append(f"{s.output:6s}  {s.tiles:6s} {s.count:7d} {numbers}")
    return "\n".join(lines)


def with_safety_offset(network: MetricNetwork, samples: Samples) -> MetricNetwork:
    """The network, with its mean underestimation on `samples` as the safety offset.

    It is `Score.mae_under` of all tiles and outputs, in transformed space, which the
    authors' programs add to what a network says before they transform it back. It makes
    fewer tiles shaded too coarsely, and costs accuracy elsewhere.

    **Raises:** `ValueError` as `evaluate`.
    """
    under = evaluate(network, samples)[0].mae_under
    offset = jnp.asarray(under, network.safety_offset.dtype)
    return eqx.tree_at(lambda n: n.safety_offset, network, offset)


def predictions(
    network: MetricNetwork, samples: Samples
) -> Float32[np.ndarray, "views outputs rows columns"]:
    """What a call of the network gives for each view, in transformed space."""
    check_fits(network, samples)
    found = []
    for i in range(len(samples)):
        x = jnp.asarray(samples.picture(network.channels, i))
        found.append(np.asarray(_called(network, x), np.float32))
    return np.stack(found)


def check_fits(network: MetricNetwork, samples: Samples) -> None:
    """Fail unless the samples are of what the network predicts."""
    for name in ("metric", "ppd", "outputs"):
        ours, theirs = getattr(network, name), getattr(samples, name)
        if ours != theirs:
            raise ValueError(f"`samples` must have {name} {ours}, got {theirs}.")
    first = next(iter(samples.inputs.values()))
    tiles = tuple(-(-side // network.region) for side in first.shape[1:])
    if samples.targets.shape[2:] != tiles:
        raise ValueError(
            f"`samples` must have {tiles[0]}x{tiles[1]} regions of {network.region} "
            f"px, got targets of shape {samples.targets.shape}."
        )


def transformed_targets(
    network: MetricNetwork, samples: Samples
) -> Float32[np.ndarray, "views outputs rows columns"]:
    """The metric in transformed space."""
    return np.asarray(network.transform(jnp.asarray(samples.targets)), np.float32)


@eqx.filter_jit
def _called(
    network: MetricNetwork, x: Float[Array, "channels height width"]
) -> Float[Array, "outputs rows columns"]:
    return network(x)


def _compared(network: MetricNetwork, samples: Samples):
    predicted = predictions(network, samples)
    return transformed_targets(network, samples), predicted


def _score(output: str, tiles: str, target: np.ndarray, predicted: np.ndarray) -> Score:
    if not target.size:
        return Score(output, tiles, 0, *[float("nan")] * 4)
    target = target.astype(np.float64)
    error = predicted - target
    spread = np.sum((target - target.mean()) ** 2)
    return Score(
        output=output,
        tiles=tiles,
        count=target.size,
        r2=float(1 - np.sum(error**2) / spread) if spread > 0 else float("nan"),
        mae=float(np.mean(np.abs(error))),
        mae_under=float(np.mean(np.maximum(-error, 0))),
        sigma=float(np.std(np.abs(error))),
    )
