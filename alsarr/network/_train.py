"""Training of a network on samples."""

import hashlib
import json
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from camojab._extras import needed

from ._checkpoint import read_checkpoint, write_checkpoint
from ._evaluate import check_fits, predictions, transformed_targets
from ._loss import adaptive_error, Statistics, training_pass
from ._model import MetricNetwork
from ._samples import counted, largest_counted, Samples


# Of the running statistics of batch normalisation, as PyTorch's default.
_MOMENTUM = 0.1
# PyTorch's defaults for RMSprop, with which the released networks were trained.
_MEMORY = 0.99
_SMALLEST = 1e-8


@dataclass(frozen=True, eq=False)
class Training:
    """What training made of a network.

    - `network`: after the step that was best on held-out samples, or the last without.
    - `step`: that step.
    - `steps`: done in all.
    - `history`: at every evaluation the step, the mean loss of training since the one
        before, and the error on held-out samples, NaN without. [1]
    """

    network: MetricNetwork
    step: int
    steps: int
    history: Float[np.ndarray, "evaluations 3"]


def train(
    network: MetricNetwork,
    samples: Samples,
    *,
    steps: int,
    batch: int = 8,
    seed: int = 0,
    held_out: Samples | None = None,
    crop: tuple[int, int] | None = None,
    flips: bool = True,
    learning_rate: float = 1e-4,
    learning_decay: float = 1.0,
    weight_decay: float = 1e-4,
    running_mean: bool = False,
    every: int = 100,
    patience: int | None = None,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int, float], None] = lambda done, total, loss: None,
) -> Training:
    """Lower the mean absolute error in transformed space (Eq. 3) by RMSprop.

    Each step takes `batch` views, cut to `crop` at random whole tiles, and mirrors half
    of them left to right, which negates the normals' x. They are never turned upside
    down: light comes from above. What is drawn depends on the seed and the number of
    the step alone, so training that was interrupted and goes on from its checkpoint
    gives the same numbers as one that was not, and may be given more `steps`. It is
    float32 whatever the precision of JAX, and is compiled once for every size of
    network, batch and crop.

    The paper says of the decay only that it is one of the learning rate, exponential,
    of 1 - 1e-4, at first with gradient descent. The authors' program has no such
    schedule; it has a weight decay of 1e-4, with which the released networks were
    trained. That is the default here, and `learning_decay=1 - 1e-4` is the other.

    **Arguments:**

    - `network`: to start from, in float32.
    - `samples`: to learn from, of its metric and outputs.
    - `steps`: to do in all. > 0
    - `batch`: views a step. > 0. The authors have 8.
    - `seed`: of all that is random.
    - `held_out`: views to judge by; without, training ends with the last step.
    - `crop`: width and height of what is taken of a view, multiples of the
        region. [px]. Left out it is the whole view.
    - `flips`: whether views are mirrored.
    - `learning_rate`: > 0. [1]
    - `learning_decay`: factor of the learning rate from step to step. [1], in (0, 1]
    - `weight_decay`: share of each weight that is added to its slope. [1], >= 0
    - `running_mean`: whether the transform follows the mean of all targets that were
        seen so far (Section 3.3.1), without those that `Samples.mean` leaves out and as
        soon as it is positive, instead of staying as it is.
    - `every`: steps between evaluations, and between writings of the checkpoint. > 0.
        The last step is evaluated too.
    - `patience`: stop after as many evaluations without improvement. > 0. Needs
        `held_out`.
    - `checkpoint`: file to go on from if it is there. It is written whole or not at
        all, every so often, at the end, and when training is interrupted.
    - `progress`: called after each step with the steps done, their number and the loss.

    **Returns:** the best network and how it came about.

    **Raises:** `ValueError` naming the argument that is out of range, for samples that
    do not fit, a loss that is not finite, and a checkpoint of another task or damaged;
    `ImportError` without optax.

    **Source:** Cardoso et al. 2022, Sections 3.3 and 4.1 and Appendix B.
    """
    size = _checked_crop(crop, samples, network.region)
    up_to = largest_counted(samples.targets) if running_mean else None
    settings = _Settings(batch, seed, size, flips, up_to, every)
    rates = _Rates(learning_rate, learning_decay, weight_decay)
    _check(network, samples, held_out, steps, settings, patience)
    task = _task(network, samples, held_out, settings, rates)
    run = _Run(network, task, None if checkpoint is None else Path(checkpoint))
    try:
        # An interruption may have come between a step and its evaluation.
        run.judge_if_due(held_out, every)
        while run.step < steps and not run.out_of(patience):
            loss = run.advance(samples, settings, rates)
            run.judge_if_due(held_out, every)
            if run.step == steps:
                run.save()
            progress(run.step, steps, loss)
        return run.result(held_out)
    except KeyboardInterrupt:
        run.save()
        raise


def check_settings(
    *,
    region: int,
    crop: tuple[int, int] | None,
    learning_rate: float,
    learning_decay: float,
) -> None:
    """Fail for what `train` would refuse whatever the samples, and without optax."""
    _needed_optax()
    _Rates(learning_rate, learning_decay, 0.0)
    if crop is not None:
        _check_whole_regions(crop, region)


class _Settings(eqx.Module, strict=True):
    batch: int
    seed: int
    crop: tuple[int, int]
    flips: bool
    mean_up_to: float | None
    every: int


class _Rates(eqx.Module, strict=True):
    """What the optimiser takes; arrays, so that other values compile nothing."""

    learning: Float[Array, ""]
    decay: Float[Array, ""]
    weight: Float[Array, ""]

    def __init__(self, learning: float, decay: float, weight: float):
        self.learning = jnp.asarray(learning, jnp.float32)
        self.decay = jnp.asarray(decay, jnp.float32)
        self.weight = jnp.asarray(weight, jnp.float32)

    def __check_init__(self):
        if not 0 < self.learning < math.inf:
            raise ValueError(f"`learning_rate` must be > 0, got {self.learning:g}.")
        if not 0 < self.decay <= 1:
            raise ValueError(f"`learning_decay` must be in (0, 1], got {self.decay:g}.")
        if not 0 <= self.weight < math.inf:
            raise ValueError(f"`weight_decay` must be >= 0, got {self.weight:g}.")


class _State(eqx.Module, strict=True):
    """All that a step changes."""

    network: MetricNetwork
    optimiser: PyTree
    step: Int[Array, ""]


class _Run:
    """A training under way: always between two steps, whatever interrupts it."""

    def __init__(self, network: MetricNetwork, task: str, path: Path | None):
        slopes = _optimiser(_Rates(1.0, 1.0, 0.0)).init(_weights(network))
        state = _State(network, slopes, jnp.zeros((), jnp.int32))
        self._task, self._path = task, path
        self._at = _Place(state, network, _Record())
        found = path and read_checkpoint(path, task, (state, network))
        if found:
            (state, best), numbers = found
            rows = tuple(map(tuple, numbers.pop("history")))
            self._at = _Place(state, best, _Record(**numbers, history=rows))

    @property
    def step(self) -> int:
        return self._at.record.step

    def advance(self, samples: Samples, settings: _Settings, rates: _Rates) -> float:
        state, best, record = self._at
        x, target = _drawn(samples, state.network.channels, settings, record.step)
        if settings.mean_up_to is not None:
            record = record.counting(counted(target, settings.mean_up_to))
            state = _centred(state, record.mean)
        state, loss = _step(state, jnp.asarray(x), jnp.asarray(target), rates)
        loss = float(loss)
        if not math.isfinite(loss):
            raise ValueError(
                f"`learning_rate` must keep the loss finite, got {loss} at step "
                f"{record.step + 1}."
            )
        # One assignment, so that an interruption finds all of the same step.
        self._at = _Place(state, best, record.after(loss))
        return loss

    def judge_if_due(self, held_out: Samples | None, every: int) -> None:
        record = self._at.record
        if record.since and record.step % every == 0:
            self._at = _judged(self._at, held_out)
            self.save()

    def out_of(self, patience: int | None) -> bool:
        return patience is not None and self._at.record.waited >= patience

    def save(self) -> None:
        if self._path is not None:
            state, best, record = self._at
            contents = (state, best)
            write_checkpoint(self._path, self._task, contents, record.numbers())

    def result(self, held_out: Samples | None) -> Training:
        # Not kept: a training of more steps does not stop to evaluate this one.
        at = _judged(self._at, held_out) if self._at.record.since else self._at
        return Training(
            network=at.best,
            step=at.record.best_step,
            steps=at.record.step,
            history=np.array(at.record.history, float).reshape(-1, 3),
        )


class _Place(NamedTuple):
    """Where a training is; without held-out samples the last evaluated is the best."""

    state: _State
    best: MetricNetwork
    record: "_Record"


@dataclass(frozen=True)
class _Record:
    """The numbers of a training that are no arrays.

    `losses` is the sum over the `since` steps after the last evaluation; `total` and
    `count` are of the targets that the running mean counts.
    """

    step: int = 0
    losses: float = 0.0
    since: int = 0
    total: float = 0.0
    count: int = 0
    best: float = math.inf
    best_step: int = 0
    waited: int = 0
    history: tuple[tuple[float, ...], ...] = ()

    def numbers(self) -> dict[str, Any]:
        return dict(vars(self))

    @property
    def mean(self) -> float:
        return self.total / max(self.count, 1)

    def counting(self, targets: np.ndarray) -> "_Record":
        total = self.total + float(targets.sum(dtype=np.float64))
        return self._with(total=total, count=self.count + targets.size)

    def after(self, loss: float) -> "_Record":
        return self._with(
            step=self.step + 1, losses=self.losses + loss, since=self.since + 1
        )

    def judged(self, error: float, better: bool) -> "_Record":
        row = (float(self.step), self.losses / max(self.since, 1), error)
        return self._with(
            losses=0.0,
            since=0,
            best=error if better else self.best,
            best_step=self.step if better else self.best_step,
            waited=0 if better else self.waited + 1,
            history=(*self.history, row),
        )

    def _with(self, **changes: Any) -> "_Record":
        return _Record(**vars(self) | changes)


@eqx.filter_jit
def _step(
    state: _State,
    x: Float[Array, "batch channels height width"],
    target: Float[Array, "batch outputs rows columns"],
    rates: _Rates,
) -> tuple[_State, Float[Array, ""]]:
    import optax

    def loss(weights):
        network = eqx.tree_at(_weights, state.network, weights)
        predicted, statistics = training_pass(network, x)
        return adaptive_error(network.transform, target, predicted), statistics

    weights = _weights(state.network)
    (value, statistics), slopes = jax.value_and_grad(loss, has_aux=True)(weights)
    changes, optimiser = _optimiser(rates).update(slopes, state.optimiser, weights)
    new = optax.apply_updates(weights, changes)
    network = eqx.tree_at(_weights, state.network, new)
    size = x.shape[0] * x.shape[2] * x.shape[3]
    network = _following(network, statistics, size)
    return _State(network, optimiser, state.step + 1), value


def _optimiser(rates: _Rates):
    """RMSprop as PyTorch has it: the epsilon outside of the root, no momentum."""
    optax = _needed_optax()
    rate = lambda step: rates.learning * rates.decay ** step.astype(jnp.float32)
    return optax.chain(
        optax.add_decayed_weights(rates.weight),
        optax.scale_by_rms(_MEMORY, _SMALLEST, eps_in_sqrt=False),
        optax.scale_by_learning_rate(rate),
    )


def _needed_optax() -> Any:
    return needed("train", "optax", "training")


def _weights(network: MetricNetwork) -> list[Any]:
    """What the slopes change."""
    parts = [(b.weight, b.bias, b.scale, b.shift) for b in network.blocks]
    return [array for block in parts for array in block]


def _following(
    network: MetricNetwork, statistics: Statistics, pixels: int
) -> MetricNetwork:
    """With running statistics that follow those of a batch."""
    blocks = []
    for block, (mean, variance) in zip(network.blocks, statistics, strict=True):
        # Of a sample, as PyTorch's, though the batch is normalised by its own.
        unbiased = variance * (pixels / max(pixels - 1, 1))
        new = tuple(
            (1.0 - _MOMENTUM) * old + _MOMENTUM * now
            for old, now in ((block.mean, mean), (block.variance, unbiased))
        )
        blocks.append(eqx.tree_at(lambda b: (b.mean, b.variance), block, new))
        pixels //= block.pool**2
    return eqx.tree_at(lambda n: n.blocks, network, tuple(blocks))


def _centred(state: _State, mean: float) -> _State:
    """With the transform about a mean, or as it is where nothing has an error yet."""
    if mean <= 0:
        return state
    transform = state.network.transform.at_mean(mean)
    return eqx.tree_at(lambda s: s.network.transform, state, transform)


def _judged(at: _Place, held_out: Samples | None) -> _Place:
    network, record = at.state.network, at.record
    error = float("nan") if held_out is None else _held_out_error(network, held_out)
    better = held_out is None or error < record.best
    best = network if better else at.best
    return _Place(at.state, best, record.judged(error, better))


def _held_out_error(network: MetricNetwork, samples: Samples) -> float:
    error = predictions(network, samples) - transformed_targets(network, samples)
    return float(np.mean(np.abs(error), dtype=np.float64))


def _drawn(
    samples: Samples, channels: tuple[str, ...], settings: _Settings, step: int
) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and targets of one step, by seed and number of the step alone."""
    random = np.random.default_rng((settings.seed, step))
    rows, columns = samples.targets.shape[2:]
    region = next(iter(samples.inputs.values())).shape[1] // rows
    wide, high = (side // region for side in settings.crop)
    xs, targets = [], []
    for view in random.integers(len(samples), size=settings.batch):
        top = random.integers(rows - high + 1)
        left = random.integers(columns - wide + 1)
        down = slice(region * top, region * (top + high))
        across = slice(region * left, region * (left + wide))
        x = samples.picture(channels, int(view), down, across)
        target = samples.targets[view, :, top : top + high, left : left + wide]
        if settings.flips and random.random() < 0.5:
            x, target = _mirrored(x, channels), target[..., ::-1]
        xs.append(x)
        targets.append(target)
    return np.stack(xs), np.stack(targets)


def _mirrored(x: np.ndarray, channels: tuple[str, ...]) -> np.ndarray:
    """Left to right; no rate is another then, but normals point the other way."""
    x = x[..., ::-1].copy()
    if "normal_x" in channels:
        x[channels.index("normal_x")] *= -1
    return x


def _checked_crop(
    crop: tuple[int, int] | None, samples: Samples, region: int
) -> tuple[int, int]:
    high, wide = next(iter(samples.inputs.values())).shape[1:]
    if crop is None:
        return wide, high
    _check_whole_regions(crop, region)
    if crop[0] > wide or crop[1] > high:
        raise ValueError(
            f"`crop` must be at most {wide}x{high} px, got {crop[0]}x{crop[1]}."
        )
    return crop


def _check_whole_regions(crop: tuple[int, int], region: int) -> None:
    if min(crop) < 1 or crop[0] % region or crop[1] % region:
        raise ValueError(
            f"`crop` must be positive multiples of {region} px, got "
            f"{crop[0]}x{crop[1]}."
        )


def _check(
    network: MetricNetwork,
    samples: Samples,
    held_out: Samples | None,
    steps: int,
    settings: _Settings,
    patience: int | None,
) -> None:
    check_fits(network, samples)
    if held_out is not None:
        check_fits(network, held_out)
    counts = {
        **{"steps": steps, "batch": settings.batch, "every": settings.every},
        "patience": 1 if patience is None else patience,
    }
    for name, count in counts.items():
        if count < 1:
            raise ValueError(f"`{name}` must be > 0, got {count}.")
    if patience is not None and held_out is None:
        raise ValueError("`patience` must be left out without `held_out`.")


def _task(
    network: MetricNetwork,
    samples: Samples,
    held_out: Samples | None,
    settings: _Settings,
    rates: _Rates,
) -> str:
    """What must be the same for a checkpoint to be of this training."""
    sha = hashlib.sha256()
    for leaf in jax.tree.leaves(network):
        sha.update(np.ascontiguousarray(leaf).tobytes())
    sha.update(jax.tree.structure(network).__repr__().encode())
    for part in (samples, held_out):
        if part is not None:
            sha.update(np.ascontiguousarray(part.targets).tobytes())
            for name in network.channels:
                if name in part.inputs:
                    sha.update(
                        str(
                            zlib.crc32(np.ascontiguousarray(part.inputs[name]).data)
                        ).encode()
                    )
    numbers = {n: float(v) for n, v in vars(rates).items()}
    sha.update(json.dumps(vars(settings) | numbers, sort_keys=True).encode())
    return sha.hexdigest()
