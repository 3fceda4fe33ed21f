"""The model sampled for tables: every pair of texture and level, rate and direction.

This is what takes time, so it is shared out over devices and processes, and what is
done is kept on disk until all is done.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Float

from camojab import (
    Auto,
    choose_fidelity,
    Display,
    Exact,
    Formulation,
    Parameters,
    pool,
    Pooled,
    pooled_quality,
    Shading,
    Spectrum,
    Viewing,
)

from .._rates import RATES
from .._stages import digest
from ._checkpoint import Checkpoint
from ._domain import Conditions, Grid, held_out
from ._rate_order import check_rates, SIDES
from ._scene import Scene


@dataclass(frozen=True)
class Samples:
    """A model's quality under the conditions that tables are fitted to and tried on.

    Made by `sample`.

    - `quality`: of every pair of `scene`, rate, direction of motion (x, y) and
      condition: those of `grid`, then those of `held_out`. [JND]
    - `rates`: of the second axis.
    - `ppd`: of the display that they are for. [px/deg]
    - `model`: one line that says which model and display the qualities come from.
    """

    quality: Float[np.ndarray, "pairs rates 2 conditions"]
    grid: Conditions
    held_out: Conditions
    scene: Scene
    rates: tuple[str, ...]
    texture_names: tuple[str, ...]
    ppd: float
    model: str


def sample(
    textures: Mapping[str, Spectrum],
    scene: Scene,
    *,
    ppd: float,
    persistence: float = 1.0,
    parameters: Parameters | None = None,
    formulation: Formulation = Formulation.RELEASED,
    fidelity: Exact | Pooled | Auto | None = None,
    rates: tuple[str, ...] = RATES.names,
    grid: Grid | None = None,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Samples:
    """Quality of everything that a scene needs, for `distil`.

    The pairs of texture and level are shared out over the local devices and, after
    `jax.distributed.initialize`, over the processes; every process returns all of them.

    **Arguments:**

    - `textures`: spectra by name, in the order of the frame's texture indices.
    - `scene`: pairs of texture and mip level, and the domain.
    - `ppd` [px/deg] and `persistence` [1] of the display that the tables are for.
    - `parameters`: of the model; the published ones of `formulation` if left out.
    - `fidelity`: `Pooled()` if left out; for `Auto` the finest of the rungs that it
      takes for the textures at their finest levels.
    - `rates`: some of `alsarr.RATES` in their order, 1x1 among them; or
      `("4", "2", "1")` for separable tables, sampled with square coarse pixels of
      these sides.
    - `grid`: conditions to fit; `Grid.over(scene.domain)` if left out.
    - `checkpoint`: a folder that remembers the pairs that are done. A call with the
      same arguments goes on from there; one with others starts anew.
    - `progress`: called with the pairs done and their number.

    **Raises:** `ValueError` if there is no texture, their number is not the scene's, or
    for rates that are not as above; as `Display` and `Shading`.

    **Source:** Jindal et al. 2021, Eq. 28: motion in y is motion in x over the
    transposed texture with the sides of the coarse pixel swapped.
    """
    if len(textures) != scene.num_textures or not textures:
        raise ValueError(
            f"`textures` must be as many as the scene's, {scene.num_textures}, got "
            f"{len(textures)}."
        )
    check_rates(rates)
    parameters = parameters or Parameters.published(formulation)
    chosen, tried = (
        (grid or Grid.over(scene.domain)).conditions(),
        held_out(scene.domain),
    )
    every = Conditions(*(jnp.concatenate(x) for x in zip(chosen, tried, strict=True)))
    display = Display(
        ppd=ppd,
        refresh_rate=every.refresh_rate,
        luminance=10.0**every.log10_luminance,
        persistence=persistence,
    )
    task = _Task(
        list(textures.values()),
        scene.pairs,
        _resolution(rates),
        (display, Viewing(every.velocity), parameters),
        formulation,
        Pooled() if fidelity is None or isinstance(fidelity, Auto) else fidelity,
    )
    if isinstance(fidelity, Auto):
        task = dataclasses.replace(task, fidelity=_chosen(fidelity, task))
    found = _all(task, checkpoint, progress)
    model = f"camojab {formulation.value}; {display.report()}; {parameters.report()}"
    return Samples(found, chosen, tried, scene, rates, tuple(textures), ppd, model)


@dataclass(frozen=True)
class _Task:
    spectra: list[Spectrum]
    pairs: tuple[tuple[int, float], ...]
    resolution: Float[np.ndarray, "rates 2"]
    shared: tuple[Display, Viewing, Parameters]
    formulation: Formulation
    fidelity: Exact | Pooled

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rates, directions and conditions of a pair."""
        return len(self.resolution), 2, self.shared[1].velocity.size

    def digest(self) -> str:
        amplitudes = [spectrum.amplitude for spectrum in self.spectra]
        text = f"{self.formulation.value} {self.fidelity!r}"
        return digest(amplitudes, self.pairs, self.resolution, self.shared, text)


def _chosen(auto: Auto, task: _Task) -> Exact | Pooled:
    """The finest rung of those that the textures need at their finest levels."""
    display, viewing, parameters = task.shared
    finest = {t: min(m for s, m in task.pairs if s == t) for t, _ in task.pairs}
    taken = []
    for texture, level in finest.items():
        rate = task.resolution[:, :, None]
        shading = Shading(rate_x=rate[:, 0], rate_y=rate[:, 1], mip_level=level)
        rung = choose_fidelity(
            task.spectra[texture],
            display,
            viewing,
            shading,
            parameters,
            formulation=task.formulation,
            fidelity=auto,
        )
        if not isinstance(rung, Exact | Pooled):
            raise ValueError(
                f"`fidelity` must take Exact or Pooled for tables, got {rung}."
            )
        taken.append(rung)
    cells = lambda rung: rung.cells if isinstance(rung, Pooled) else float("inf")
    return max(taken, key=cells)


def _resolution(rates: tuple[str, ...]) -> Float[np.ndarray, "rates 2"]:
    if rates == SIDES:
        return np.array([[1 / int(side)] * 2 for side in rates])
    return RATES.resolution[[RATES.names.index(name) for name in rates]]


def _all(
    task: _Task,
    checkpoint: str | Path | None,
    progress: Callable[[int, int], None],
) -> Float[np.ndarray, "pairs rates 2 conditions"]:
    done = Checkpoint(checkpoint, task.digest if checkpoint else lambda: "")
    mine = list(range(len(task.pairs)))[jax.process_index() :: jax.process_count()]
    found = {i: known for i in mine if (known := done.read(i, task.shape)) is not None}
    missing = [i for i in mine if i not in found]
    devices = jax.local_devices()[: max(1, len(missing))]
    run = _over(devices, task.formulation, task.fidelity)
    for start in range(0, len(missing), len(devices)):
        progress(len(found), len(mine))
        some = missing[start : start + len(devices)]
        # The last call repeats a pair rather than being compiled for fewer.
        padded = some + some[-1:] * (len(devices) - len(some))
        new = np.asarray(run(_stacked(task, padded), task.shared), np.float32)
        for i, quality in zip(some, new, strict=False):
            done.write(i, quality)
            found[i] = quality
    progress(len(mine), len(mine))
    return _gathered([found[i] for i in mine], len(task.pairs))


def _stacked(task: _Task, some: list[int]) -> tuple[Spectrum, Shading, Shading]:
    """Spectra and the shading of both directions, with an axis for the pairs."""

    def shading(turn: int) -> Shading:
        rate = np.broadcast_to(
            task.resolution[:, ::turn], (len(some), *task.resolution.shape)
        )
        level = np.array([task.pairs[i][1] for i in some])[:, None]
        return Shading(
            rate_x=rate[..., 0],
            rate_y=rate[..., 1],
            mip_level=np.broadcast_to(level, rate.shape[:2]),
        )

    spectra = [task.spectra[task.pairs[i][0]] for i in some]
    return jax.tree.map(lambda *x: jnp.stack(x), *spectra), shading(1), shading(-1)


def _over(
    devices: list, formulation: Formulation, fidelity: Exact | Pooled
) -> Callable:
    """The same for one pair on each device, compiled once."""

    def one(
        pair: tuple[Spectrum, Shading, Shading],
        shared: tuple[Display, Viewing, Parameters],
    ) -> Array:
        spectrum, along_x, along_y = pair
        both = (spectrum, along_x), (spectrum.transposed(), along_y)
        of = lambda s, rates: _quality(s, rates, *shared, formulation, fidelity)
        return jnp.stack([of(*direction) for direction in both], axis=1)

    def local(pairs, shared) -> Array:
        return jax.lax.map(lambda pair: one(pair, shared), pairs)

    pairs = PartitionSpec("pairs")
    return jax.jit(
        jax.shard_map(
            local,
            mesh=Mesh(np.array(devices), ("pairs",)),
            in_specs=(pairs, PartitionSpec()),
            out_specs=pairs,
            check_vma=False,
        )
    )


def _quality(
    spectrum: Spectrum,
    rates: Shading,
    display: Display,
    viewing: Viewing,
    parameters: Parameters,
    formulation: Formulation,
    fidelity: Exact | Pooled,
) -> Float[Array, "rates n"]:
    def one(rate: Shading) -> Float[Array, " n"]:
        pooled = pool(
            spectrum, rate, parameters, formulation=formulation, fidelity=fidelity
        )
        return pooled_quality(pooled, display, viewing)

    return jax.lax.map(one, rates)


def _gathered(mine: list[np.ndarray], total: int) -> np.ndarray:
    """Everyone's, in the order of the pairs."""
    if jax.process_count() == 1:
        return np.stack(mine)
    from jax.experimental.multihost_utils import process_allgather

    most = -(-total // jax.process_count())
    padded = np.stack(mine + [np.zeros_like(mine[0])] * (most - len(mine)))
    # Pair i is the (i // processes)-th of process i % processes.
    every = np.asarray(process_allgather(padded))
    return every.swapaxes(0, 1).reshape(-1, *padded.shape[1:])[:total]
