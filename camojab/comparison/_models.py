"""The three models of Table 5, each from a table of conditions to qualities.

Qualities to be compared with JND are relative to the row `reference`; to be compared
with opinion scores, they are as the model gives them.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._display import Display
from .._parameters import Formulation, Parameters
from .._quality import distortion
from .._spectrum import Spectrum
from ..baselines import (
    pixels_per_frame,
    quality_terms_denes2020,
    quality_yang2019,
    texture_error_yang2019,
)
from ..fit._problem import conditions


Textures = Mapping[str, Float[np.ndarray, "height width"]]


def camojab(
    table: Any, textures: Textures, parameters: Parameters, formulation: Formulation
) -> Float[np.ndarray, " rows"]:
    """Jindal et al. 2021; only its temporal distortion where only judder differs."""
    quality = np.empty(len(table))
    names, judder = table["texture"].to_numpy(), table["temporal_only"].to_numpy(bool)
    ws, wt = float(parameters.ws), float(parameters.wt)
    for name in dict.fromkeys(names):
        rows = names == name
        spectrum = Spectrum.from_texture(textures[name])
        described = conditions(table[rows])
        parts = distortion(spectrum, *described, parameters, formulation=formulation)
        spatial = np.where(judder[rows], 0.0, np.asarray(parts.spatial, float))
        quality[rows] = ws * spatial + wt * np.asarray(parts.temporal, float)
    return _relative(table, quality)


def marrr(table: Any, textures: Textures) -> Float[np.ndarray, " rows"]:
    """Denes et al. 2020, released constants.

    Where only judder differs, the judder of the rate minus that of twice the rate: the
    pair that was compared in their Experiment 3, a difference already.
    """
    del textures
    display, viewing, shading = conditions(table)
    doubled = Display(
        ppd=display.ppd,
        refresh_rate=2.0 * display.refresh_rate,
        luminance=display.luminance,
        persistence=display.persistence,
    )
    terms = quality_terms_denes2020(display, viewing, shading)
    twice = quality_terms_denes2020(doubled, viewing, shading)
    quality = np.asarray(terms.parallel + terms.orthogonal + terms.judder, float)
    only_judder = np.asarray(terms.judder - twice.judder, float)
    return np.where(table["temporal_only"], only_judder, _relative(table, quality))


def nas(table: Any, textures: Textures) -> Float[np.ndarray, " rows"]:
    """Yang et al. 2019 along the motion, with this package's error of a texture."""
    display, viewing, shading = conditions(table)
    names = dict.fromkeys(table["texture"])
    errors = {n: float(texture_error_yang2019(textures[n])[0]) for n in names}
    error = table["texture"].map(errors).to_numpy(float)
    speed = pixels_per_frame(display, viewing)
    quality = np.asarray(quality_yang2019(error, shading.rate_x, speed), float)
    return _relative(table, quality)


def _relative(
    table: Any, quality: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, " rows"]:
    anchor = quality[table["reference"].to_numpy(int)]
    return np.where(table["unit"] == "JND", quality - anchor, quality)
