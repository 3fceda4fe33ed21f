"""Light of a scene to the bytes of a picture."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, UInt8

from .._picture import encoded


MIDDLE_GREY = 0.18
"""What the log-average luminance of a picture is mapped to. [1]"""

# Of red, green and blue light in luminance, ITU-R BT.709.
_WEIGHTS = (0.2126, 0.7152, 0.0722)

# Black pixels alone do not make a picture infinitely dark.
_DARK = 1e-4


def automatic_exposure(radiance: Float32[np.ndarray, "*pixels 3"]) -> np.float32:
    """What a picture's light is multiplied by: middle grey over its log-average.

    **Arguments:**

    - `radiance`: linear light of ITU-R BT.709's primaries. >= 0.

    **Returns:** > 0 and at most `MIDDLE_GREY` / 1e-4.

    **Source:** Reinhard et al. (2002), Photographic Tone Reproduction for Digital
    Images, Eq. 1 and 2.
    """
    luminance = radiance @ np.asarray(_WEIGHTS, np.float32)
    average = np.exp(np.mean(np.log(luminance + np.float32(_DARK)), dtype=np.float64))
    return np.float32(MIDDLE_GREY / average)


@jax.jit
def tone_mapped(
    radiance: Float[Array, "*pixels 3"], exposure: Float[Array, ""]
) -> UInt8[Array, "*pixels 3"]:
    """Expose, compress with a fit of the ACES curve, encode as sRGB, and round.

    **Source:** Narkowicz (2016), ACES Filmic Tone Mapping Curve, with his factor 0.6
    of exposure; IEC 61966-2-1.
    """
    x = 0.6 * exposure * radiance
    curve = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)
    return to_bytes(encoded(jnp.clip(curve, 0.0, 1.0)))


def to_bytes(share: Float[Array, "*n"]) -> UInt8[Array, "*n"]:
    """Shares of 1 as the nearest bytes."""
    return jnp.round(jnp.clip(share, 0.0, 1.0) * 255.0).astype(jnp.uint8)
