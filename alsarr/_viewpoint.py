"""One captured viewpoint under a budget: the pictures that rate maps make of it."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from camojab import Spectrum

from ._rates import RATES, TILE
from .capture import Scene, Texels, View
from .metrics import flip, METRICS
from .oracle import CamojabOracle
from .solve import lagrangian
from .tables import Scene as Needs


# Of a texture as the model looks at it. [texels]
_SIDE = 512


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


def rate_map(
    view: View, quality: Float[Array, "tiles 7"], *, budget: float, ppd: float
) -> RateMap:
    """The best rates of some qualities, and the picture shaded at them.

    **Arguments:**

    - `budget`: share of full rate everywhere. [1], in [1/16, 1]
    - `ppd`: at which the picture's error is seen. [px/deg], > 0

    **Raises:** `ValueError` as `alsarr.solve.lagrangian` and `alsarr.metrics.flip`.
    """
    width, height = view.size
    shape = -(-height // TILE), -(-width // TILE)
    cost = jnp.broadcast_to(jnp.asarray(RATES.cost)[None], quality.shape)
    allowed = budget * quality.shape[0] * float(RATES.cost.max())
    # The solver's guarantee is for qualities over those of the coarsest rate.
    gain = quality - quality[:, :1]
    found = lagrangian(gain, cost.astype(gain.dtype), allowed)
    rate = np.asarray(found.rate).reshape(shape)
    picture = shaded(view, rate)
    error = flip(_light(view.reference), _light(picture), ppd=ppd)
    share = float(found.cost) / (quality.shape[0] * float(RATES.cost.max()))
    return RateMap(rate, picture, float(error.mean()), share)


def shaded(
    view: View, rate: Int[np.ndarray, "rows columns"]
) -> UInt8[np.ndarray, "height width 3"]:
    """The viewpoint's picture with each tile shaded at its rate, as it was captured."""
    width, height = view.size
    pixel = rate.repeat(TILE, axis=0).repeat(TILE, axis=1)[:height, :width]
    return np.take_along_axis(view.images, pixel[None, ..., None], axis=0)[0]


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
    spectra = {
        scene.texture_name[i]: texture_spectrum(scene, i) for i in occurring.tolist()
    }
    refresh = (refresh_rate, refresh_rate)
    needs = Needs.of_frames([frame], num_textures=len(spectra), refresh_rate=refresh)
    oracle = CamojabOracle(spectra, pairs=needs.pairs, ppd=ppd, persistence=persistence)
    return oracle.quality(frame, refresh_rate)


def texture_spectrum(scene: Scene, index: int) -> Spectrum:
    """Spectrum of a scene's texture, repeated where it is smaller than 512 texels."""
    texels: Texels = scene.texels
    start, width, height = (
        int(x[index, 0]) for x in (texels.offset, texels.width, texels.height)
    )
    picture = np.asarray(texels.texel[start : start + width * height])
    picture = picture.reshape(height, width, 3)
    times = -(-_SIDE // height), -(-_SIDE // width)
    repeated = np.tile(picture[:_SIDE, :_SIDE], (*times, 1))[:_SIDE, :_SIDE]
    return Spectrum.from_texture(np.clip(repeated, 0, 1), encoding="linear")


def _light(picture: UInt8[np.ndarray, "height width 3"]) -> Array:
    return jnp.asarray(picture, jnp.float32) / 255
