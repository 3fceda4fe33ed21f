"""One captured viewpoint under a budget: the pictures that rate maps make of it."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from ._rates import RATES, TILE
from ._run import check_budget
from .capture import Scene, View
from .metrics import flip, METRICS
from .oracle import CamojabOracle
from .solve import lagrangian, Selection
from .tables import Scene as Needs


class RateMap(NamedTuple):
    """What an oracle makes of a budget.

    - `rate`: of each tile, as an index into `alsarr.RATES`.
    - `picture`: shaded so, sRGB bytes.
    - `flip`: its mean error. [1]
    - `cost`: as a share of full rate everywhere. [1]
    """

    rate: Int[np.ndarray, "rows columns"]
    picture: UInt8[np.ndarray, "height width 3"]
    flip: float
    cost: float


def best_rates(quality: Float[Array, "tiles 7"], budget: float) -> Selection:
    """The best rates that cost no more than a share of full rate everywhere.

    **Arguments:**

    - `budget`: the share. [1], in [1/16, 1]

    **Raises:** `ValueError` for a budget out of range, and as
    `alsarr.solve.lagrangian`.
    """
    check_budget(budget)
    cost = jnp.broadcast_to(jnp.asarray(RATES.cost)[None], quality.shape)
    allowed = budget * quality.shape[0] * float(RATES.cost.max())
    # The solver's guarantee is for qualities over those of the coarsest rate.
    gain = quality - quality[:, :1]
    return lagrangian(gain, cost.astype(gain.dtype), allowed)


def rate_map(
    view: View, quality: Float[Array, "tiles 7"], *, budget: float, ppd: float
) -> RateMap:
    """The best rates of some qualities, and the picture shaded at them.

    **Arguments:**

    - `budget`: share of full rate everywhere. [1], in [1/16, 1]
    - `ppd`: at which the picture's error is seen. [px/deg], > 0

    **Raises:** `ValueError` as `best_rates` and `alsarr.metrics.flip`.
    """
    width, height = view.size
    shape = -(-height // TILE), -(-width // TILE)
    found = best_rates(quality, budget)
    rate = np.asarray(found.rate).reshape(shape)
    picture = view.shaded(rate)
    error = flip(_light(view.reference), _light(picture), ppd=ppd)
    share = float(found.cost) / (quality.shape[0] * float(RATES.cost.max()))
    return RateMap(rate, picture, float(error.mean()), share)


def measured(view: View, metric: str, *, ppd: float) -> Float[Array, "7 rows columns"]:
    """The metric of every tile at every rate, of the captured pictures."""
    of: Callable[..., Array] = METRICS[metric]
    reference = _light(view.reference)
    return jnp.stack([of(reference, _light(x), ppd=ppd) for x in view.images])


def camojab_quality(
    view: View,
    scene: Scene,
    *,
    ppd: float,
    refresh_rate: float,
    peak_luminance: float,
    persistence: float = 1.0,
) -> Float[Array, "tiles 7"]:
    """CaMoJAB of every tile, with the spectra of the scene's own textures. [JND]

    **Arguments:**

    - `scene`: that the view was captured of.
    - `ppd` [px/deg], `refresh_rate` [Hz], `peak_luminance` [cd/m^2], `persistence` [1]:
        of the display.
    """
    frame = view.frame(
        ppd=ppd, refresh_rate=refresh_rate, peak_luminance=peak_luminance
    )
    occurring, index = np.unique(np.asarray(frame.texture), return_inverse=True)
    shape = frame.texture.shape
    index = jnp.asarray(index.reshape(shape), frame.texture.dtype)
    frame = eqx.tree_at(lambda f: f.texture, frame, index)
    spectra = {scene.texture_name[i]: scene.spectrum(i) for i in occurring.tolist()}
    refresh = (refresh_rate, refresh_rate)
    needs = Needs.of_frames([frame], num_textures=len(spectra), refresh_rate=refresh)
    oracle = CamojabOracle(spectra, pairs=needs.pairs, ppd=ppd, persistence=persistence)
    return oracle.quality(frame, refresh_rate)


def _light(picture: UInt8[np.ndarray, "height width 3"]) -> Array:
    return jnp.asarray(picture, jnp.float32) / 255
