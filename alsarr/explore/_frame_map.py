"""A drawn frame, and the shading rates that oracles choose for it within a budget."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from camojab import Spectrum

from .._frame import Frame, mean_velocity, procedural_frame
from .._frame._procedural import procedural_picture
from .._rates import RATES
from ..oracle import (
    AbstractQualityOracle,
    CamojabOracle,
    Denes2020Oracle,
    FidelityFxOracle,
    TableOracle,
    UniformOracle,
    Yang2019Oracle,
)
from ..solve import lagrangian
from ..tables import distil, Eq31LogTravel, Form, sample, Scene
from ._conditions import Conditions, RANGES


# A frame of 640 x 360 pixels.
_ROWS, _COLUMNS, _SEED = 23, 40, 2021

TABLES_DISPLAY = Conditions(ppd=60.0, persistence=1.0)
"""The display that the tables are distilled for, whatever the sliders say."""


@dataclass(frozen=True)
class DrawnFrame:
    """A frame, its picture, and what tells the quality of its tiles.

    - `frame`: with the picture before it.
    - `judge`: the model itself, by which all oracles are judged.
    - `oracles`: by the name that people read, the judge among them.
    """

    frame: Frame
    judge: CamojabOracle
    oracles: Mapping[str, AbstractQualityOracle]


class RateMap(NamedTuple):
    """What an oracle buys with a budget.

    - `rate`: index into `alsarr.RATES` of each tile.
    - `shares`: of the tiles that have each rate.
    - `cost`: what is spent, as a share of full rate everywhere.
    - `loss`: what a tile loses to its rate on average, by the judge. [JND]
    """

    rate: Int[np.ndarray, "rows columns"]
    shares: Float[np.ndarray, " rates"]
    cost: float
    loss: float


def drawn_frame(
    textures: Mapping[str, Float[np.ndarray, "rows columns"]],
    spectra: Mapping[str, Spectrum],
) -> DrawnFrame:
    """The street of `alsarr.procedural_frame`, 40 x 23 tiles, with these textures.

    **Arguments:** `textures`: relative luminance; `spectra`: of the same, in order.
    """
    frame = procedural_frame(len(textures), rows=_ROWS, columns=_COLUMNS, seed=_SEED)
    # Half the peak is the brightest tile's mean, so hardly a texel is cut off.
    peak = 2 * float(frame.luminance.max())
    picture = procedural_picture(frame, list(textures.values()), peak_luminance=peak)
    buffers = {name: getattr(frame, name) for name in Frame.UNITS}
    ppd = Conditions().ppd
    scene = _scene(frame, len(textures))
    judge = CamojabOracle(spectra, ppd=ppd, pairs=scene.pairs)
    return DrawnFrame(
        frame=Frame(**buffers, previous_image=picture),
        judge=judge,
        oracles={
            "CaMoJAB": judge,
            "NAS (Yang et al. 2019)": Yang2019Oracle(ppd=ppd),
            "FidelityFX": FidelityFxOracle(ppd=ppd),
            "MARRR (Denes et al. 2020)": Denes2020Oracle(ppd=ppd),
            "uniform": UniformOracle(),
        },
    )


def distilled(
    of: DrawnFrame,
    spectra: Mapping[str, Spectrum],
    progress: Callable[[int, int], None],
) -> AbstractQualityOracle:
    """Polynomial tables of the frame's textures, for `TABLES_DISPLAY`.

    Takes some ten seconds. `progress` is called with the steps done and their number,
    and may raise to end it.
    """
    scene = _scene(of.frame, len(spectra))
    samples = sample(
        spectra,
        scene,
        ppd=TABLES_DISPLAY.ppd,
        persistence=TABLES_DISPLAY.persistence,
        progress=progress,
    )
    return TableOracle(distil(samples, Form(Eq31LogTravel())))


def _scene(frame: Frame, textures: int) -> Scene:
    rates = RANGES["refresh_rate"]
    return Scene.of_frames([frame], num_textures=textures, refresh_rate=rates)


def adapted(frame: Frame, at: Conditions) -> Frame:
    """The frame with its mean speed and its mean luminance at those of `at`."""
    speed = at.velocity / float(mean_velocity(frame))
    light = at.luminance / float(jnp.mean(frame.luminance))
    of = lambda f: (f.velocity_x, f.velocity_y, f.luminance)
    parts = frame.velocity_x * speed, frame.velocity_y * speed, frame.luminance * light
    return eqx.tree_at(of, frame, parts)


def qualities(
    oracle: AbstractQualityOracle, frame: Frame, at: Conditions
) -> Float[Array, "tiles 7"]:
    """Quality of each tile at each rate, on the display of `at`, in the oracle's unit.

    Compiled once for each kind of oracle.
    """
    return _qualities(oracle, frame, at.array())


@eqx.filter_jit
def _qualities(
    oracle: AbstractQualityOracle, frame: Frame, at: Float[np.ndarray | Array, "5"]
) -> Float[Array, "tiles 7"]:
    _, refresh_rate, persistence, ppd, _ = at
    for name, value in {"ppd": ppd, "persistence": persistence}.items():
        if hasattr(oracle, name):
            own = getattr(oracle, name)
            of = lambda o, name=name: getattr(o, name)
            oracle = eqx.tree_at(of, oracle, value.astype(own.dtype))
    return oracle.quality(frame, refresh_rate)


def rate_map(
    quality: Float[Array, "tiles 7"],
    judged: Float[Array, "tiles 7"],
    budget: float,
    shape: tuple[int, int],
) -> RateMap:
    """The rates that buy the most of `quality` within a budget.

    **Arguments:**

    - `quality`: by the oracle that chooses, `judged`: by the judge. [JND]
    - `budget`: share of the cost of full rate everywhere, [1/16, 1].
    - `shape`: rows and columns of tiles.
    """
    rate, cost, loss = _chosen(quality, judged, np.float32(budget))
    rate = np.asarray(rate)
    return RateMap(
        rate=rate.reshape(shape),
        shares=np.bincount(rate, minlength=len(RATES)) / rate.size,
        cost=float(cost),
        loss=float(loss),
    )


@eqx.filter_jit
def _chosen(
    quality: Float[Array, "tiles 7"],
    judged: Float[Array, "tiles 7"],
    budget: Float[np.ndarray | Array, ""] | np.float32,
) -> tuple[Int[Array, " tiles"], Float[Array, ""], Float[Array, ""]]:
    cost = jnp.asarray(RATES.cost, quality.dtype)
    full = cost[-1] * quality.shape[0]
    # Rounding must not put 4x4 everywhere beyond the smallest budget.
    allowed = jnp.maximum(budget.astype(quality.dtype) * full, cost[0] * len(quality))
    found = lagrangian(quality, cost, allowed, throw=False)
    kept = jnp.take_along_axis(judged, found.rate[:, None], axis=1)[:, 0]
    return found.rate, found.cost / full, jnp.mean(judged[:, -1] - kept)
