"""Six textures that need no download."""

import numpy as np
from jaxtyping import Float64

from .._colour_science import colour_science


_SIZE = 512


def builtin_textures() -> dict[str, Float64[np.ndarray, "512 512"]]:
    """Three photographs and three drawings, as relative luminance.

    `brick`, `grass` and `gravel` are the photographs that come with scikit-image (CC0),
    whose sRGB code values are decoded here. `checkerboard`, `gradient` and `noise` are
    drawn about a mean of 0.5 with the Michelson contrasts of the textures of the same
    name in Table 3 of Jindal et al. 2021, 0.7, 0.9 and 0.8: squares of 32 pixels turned
    by 10 degrees; a linear ramp along x; salt and pepper on 1/16 of the pixels, as much
    of one as of the other, always the same (standard deviation 0.1; the authors'
    texture has 0.095).

    **Returns:** arrays indexed (y, x), linear luminance relative to white, in [0, 1].

    **Raises:** nothing.
    """
    return _photographs() | {
        "checkerboard": _checkerboard(contrast=0.7, square=32.0, turn_deg=10.0),
        "noise": _noise(contrast=0.8, density=1 / 16),
        "gradient": _gradient(contrast=0.9),
    }


def _photographs() -> dict[str, Float64[np.ndarray, "512 512"]]:
    from skimage import data

    decoding = colour_science().cctf_decoding
    images = {"brick": data.brick(), "grass": data.grass(), "gravel": data.gravel()}
    return {
        name: np.asarray(decoding(image / 255, function="sRGB"))
        for name, image in images.items()
    }


def _checkerboard(
    *, contrast: float, square: float, turn_deg: float
) -> Float64[np.ndarray, "512 512"]:
    """Turned, with 4 x 4 samples a texel: squares along the axes have no spectrum.

    An aligned board puts all its energy on a few bins, which a power below one hardly
    counts; no photograph does that, nor the board of the experiments, turned by 45 deg.
    """
    samples = 4
    y, x = np.mgrid[: _SIZE * samples, : _SIZE * samples] / samples
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    u, v = (x * cos + y * sin) / square, (y * cos - x * sin) / square
    sign = np.where((np.floor(u) + np.floor(v)) % 2 == 0, 1.0, -1.0)
    sign = sign.reshape(_SIZE, samples, _SIZE, samples).mean(axis=(1, 3))
    return 0.5 * (1 + contrast * sign)


def _noise(*, contrast: float, density: float) -> Float64[np.ndarray, "512 512"]:
    each = round(_SIZE**2 * density / 2)
    sign = np.zeros(_SIZE**2)
    sign[:each], sign[each : 2 * each] = 1, -1
    np.random.default_rng(2021).shuffle(sign)
    return 0.5 * (1 + contrast * sign.reshape(_SIZE, _SIZE))


def _gradient(*, contrast: float) -> Float64[np.ndarray, "512 512"]:
    ramp = 0.5 * (1 + contrast * np.linspace(-1, 1, _SIZE))
    return np.tile(ramp, (_SIZE, 1))
