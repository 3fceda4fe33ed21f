"""The spectrum of a texture along the motion, after each stage of the model."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from camojab import (
    Components,
    Display,
    LowPass,
    Parameters,
    sensitivity,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._condition import Condition, log_eye_blur
from camojab._filters import log_lorentzian, mipmap
from camojab._released import judder_shift, shade
from camojab._spectrum import SIZE

from ._conditions import Conditions


HALF = SIZE // 2

# How many of the 512 x 512 bins lie at each distance from frequency 0 along x.
_COUNT = SIZE * np.where(np.isin(np.arange(HALF + 1), (0, HALF)), 1.0, 2.0)

# Where the horizontal frequency is the larger one and is the model's radial frequency.
_WIDER = np.arange(HALF + 1)[:, None] <= np.arange(HALF + 1)[None, :]


class Chain(eqx.Module):
    """Squared amplitudes of a texture at one mip level and rate, summed for drawing.

    Rows are distances from vertical frequency 0, columns horizontal frequencies of
    either sign, -256 to 255. [1].

    - `texture`: before anything.
    - `mipmapped`: after the mipmap filter; its sum over the rows and signs.
    - `shaded`: after the replicas and the crop of coarse shading.
    - `parameters`: of the model.
    """

    texture: Float[Array, "257 512"]
    mipmapped: Float[Array, "257"]
    shaded: Float[Array, "257 512"]
    parameters: Parameters


class Stages(NamedTuple):
    """Amplitudes after each stage, root mean squares over vertical frequency.

    At horizontal frequencies `frequency` [cycles/deg], both signs together, from the
    first bin above 0 to the Nyquist frequency. [1]; exact zeros where a stage leaves
    nothing.

    - `texture`, `mipmap`, `coarse_shading`, `hold`, `pursuit`, `perceived`: one stage
        after another; the last is weighed with the contrast sensitivity.
    - `reference`: what the last is compared with: the texture, weighed alike.
    - `replica`: the temporal replica of the shaded texture, weighed with the
        sensitivity at the refresh rate.
    """

    frequency: Float[np.ndarray, "256"]
    texture: Float[np.ndarray, "256"]
    mipmap: Float[np.ndarray, "256"]
    coarse_shading: Float[np.ndarray, "256"]
    hold: Float[np.ndarray, "256"]
    pursuit: Float[np.ndarray, "256"]
    perceived: Float[np.ndarray, "256"]
    reference: Float[np.ndarray, "256"]
    replica: Float[np.ndarray, "256"]


@eqx.filter_jit
def chain(spectrum: Spectrum, of: Shading, parameters: Parameters) -> Chain:
    """All of the chain that no display and no motion changes.

    **Arguments:** `parameters`: scalars, of the released formulation.

    **Source:** Jindal et al. 2021, Eq. 3 and 8 to 13, in the released formulation.
    """
    amplitude = spectrum.amplitude
    own, p = jax.tree.map(lambda x: x.astype(amplitude.dtype), (of, parameters))
    filtered = mipmap(amplitude, own, p.mipmap_width, LowPass.LORENTZIAN)
    shaded = shade(amplitude, own, Components(), p)
    whole = _folded(filtered**2)
    return Chain(
        texture=_folded(amplitude**2),
        mipmapped=jnp.sum(_folded(whole, axis=1), axis=0),
        shaded=_folded(shaded**2),
        parameters=p,
    )


def stages(of: Chain, at: Conditions) -> Stages:
    """The spectrum after each stage, under some conditions.

    Compiled once, whatever the texture and the conditions.

    **Source:** Jindal et al. 2021, Eq. 8 to 22, in the released formulation.
    """
    found = np.asarray(_stages(of, at.array()))[:, 1:]
    frequency = np.arange(1, HALF + 1) * (at.ppd / SIZE)
    return Stages(frequency, *found)


@eqx.filter_jit
def _stages(
    of: Chain, at: Float[np.ndarray | Array, "5"]
) -> Float[Array, "stages 257"]:
    p, dtype = of.parameters, of.texture.dtype
    velocity, refresh_rate, persistence, ppd, luminance = at.astype(dtype)
    display = Display(
        ppd=ppd,
        refresh_rate=refresh_rate,
        luminance=luminance,
        persistence=persistence,
    )
    c = Condition(display, Viewing(velocity), Shading(), Components(), p)
    rho = jnp.arange(HALF + 1, dtype=dtype) * (ppd / SIZE)
    hold = p.hold_width * persistence * velocity / refresh_rate
    after_hold = jnp.exp(2 * log_lorentzian(rho, jnp.broadcast_to(hold, rho.shape)))
    after_eye = jnp.exp(2 * log_eye_blur(rho, c))

    squared = lambda f: jnp.square(sensitivity(rho, f, luminance))
    still, flicker = squared(jnp.zeros_like(rho)), squared(refresh_rate)
    texture, shaded = _folded(of.texture, axis=1), _folded(of.shaded, axis=1)
    moved = _folded(_moved(of.shaded, judder_shift(c)), axis=1)
    plain = jnp.sum(shaded, axis=0)
    power = jnp.stack(
        [
            jnp.sum(texture, axis=0),
            of.mipmapped,
            plain,
            plain * after_hold,
            plain * after_eye,
            _weighed(shaded, still) * after_eye,
            _weighed(texture, still),
            _weighed(moved, flicker),
        ]
    )
    return jnp.sqrt(power / jnp.asarray(_COUNT, dtype)[None])


def _moved(
    power: Float[Array, "257 512"], bins: Int[Array, ""]
) -> Float[Array, "257 512"]:
    """Moved right by 0 to 512 bins, with zeros from the left."""
    padded = jnp.pad(power, ((0, 0), (SIZE, 0)))
    return jax.lax.dynamic_slice_in_dim(padded, SIZE - bins, SIZE, axis=1)


def _weighed(
    power: Float[Array, "257 257"], by: Float[Array, "257"]
) -> Float[Array, "257"]:
    """Sums over the rows, each bin times what `by` has at its radial frequency."""
    wider = jnp.sum(jnp.where(_WIDER, power, 0), axis=0)
    return wider * by + jnp.dot(by, jnp.where(_WIDER, 0, power))


def _folded(power: Float[Array, "n m"], axis: int = 0) -> Float[Array, "..."]:
    """Sums over the sign of the frequency along an axis: bins -256..255 become 257."""
    power = jnp.moveaxis(power, axis, 0)
    negative = power[HALF::-1]
    both = negative.at[1:HALF].add(power[HALF + 1 :])
    return jnp.moveaxis(both, 0, axis)
