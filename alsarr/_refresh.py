"""The refresh rate that a velocity asks for within a budget: Eq. 24, as a table."""

import math
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from camojab import (
    Display,
    Formulation,
    Parameters,
    quality,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._errors import check, shown
from camojab._fidelity import AbstractFidelity
from camojab.baselines import Denes2020, quality_denes2020

from ._rates import RATES


Numbers = Sequence[float | int] | Float[np.ndarray, " n"]

# What 4x4 everywhere leaves of each axis.
_COARSEST = float(np.min(RATES.resolution))


class RefreshChoice(eqx.Module, strict=True):
    """What a refresh-rate table says of some velocities, in their shape.

    - `velocity`: the entry that was taken. [deg/s]
    - `refresh_rate`: the best one. [Hz]
    - `resolution`: shading resolution of both axes that it leaves. [1], in (0, 1]
    - `quality`: at both. [JND]
    """

    velocity: Float[Array, "..."]
    refresh_rate: Float[Array, "..."]
    resolution: Float[Array, "..."]
    quality: Float[Array, "..."]


class RefreshTable(eqx.Module, strict=True):
    """Velocity -> refresh rate and resolution of the best quality within a budget.

    Made by `refresh_table`.

    - `velocity`: of the entries, rising. [deg/s]
    - `refresh_rate`, `resolution`, `quality`: of the best candidate for each velocity.
        [Hz], [1], [JND]
    - `candidates`: refresh rates that were compared, rising. [Hz]
    - `candidate_resolution`: resolution of both axes that the budget leaves at each.
        [1], in [1/4, 1]
    - `candidate_quality`: quality of each for each velocity. [JND]
    - `highest`: of the refresh rates that were asked for, those included that not even
        4x4 everywhere leaves within the budget. [Hz]
    - `pixels_per_second`: the budget. [px/s]
    """

    velocity: Float[Array, " velocities"]
    refresh_rate: Float[Array, " velocities"]
    resolution: Float[Array, " velocities"]
    quality: Float[Array, " velocities"]
    candidates: Float[Array, " rates"]
    candidate_resolution: Float[Array, " rates"]
    candidate_quality: Float[Array, "velocities rates"]
    highest: Float[Array, ""]
    pixels_per_second: Float[Array, ""]

    UNITS: ClassVar[dict[str, str]] = {
        "velocity": "deg/s",
        "refresh_rate": "Hz",
        "resolution": "1",
        "quality": "JND",
    }

    def lookup(self, velocity: ArrayLike) -> RefreshChoice:
        """The entry whose velocity is nearest; of two as near, that of the slower.

        **Arguments:** `velocity`: pooled over the frame; the paper takes the mean.
        [deg/s], >= 0. Any shape. Beyond the last entry it is the last.

        **Raises:** `ValueError` for a negative or infinite velocity; under a JAX
        transformation the same sentence at run time.
        """
        rule = "finite and >= 0 deg/s"
        speed = check("velocity", velocity, lambda v: (v >= 0) & (v < math.inf), rule)
        middles = (self.velocity[1:] + self.velocity[:-1]) / 2
        entry = jnp.searchsorted(middles, speed.astype(middles.dtype), side="left")
        return RefreshChoice(
            self.velocity[entry],
            self.refresh_rate[entry],
            self.resolution[entry],
            self.quality[entry],
        )


def every_rate(highest: int, lowest: int = 1) -> Float[np.ndarray, " rates"]:
    """Each whole refresh rate of an adaptive-sync display, `lowest` to `highest` [Hz].

    **Raises:** `ValueError` unless 1 <= `lowest` <= `highest`.

    **Example:**

    >>> import numpy as np
    >>> from alsarr import every_rate
    >>> print(np.asarray(every_rate(120, 110)).round(1))
    [110. 111. 112. 113. 114. 115. 116. 117. 118. 119. 120.]
    """
    if not 1 <= lowest <= highest:
        raise ValueError(
            f"`lowest` must be from 1 to `highest` Hz, got {lowest} and {highest}."
        )
    return np.arange(lowest, highest + 1, dtype=float)


def refresh_table(
    spectrum: Spectrum,
    *,
    ppd: ArrayLike,
    luminance: ArrayLike,
    pixels_per_second: float | int,
    resolution_px: tuple[int, int],
    refresh_rates: Numbers,
    velocities: Numbers,
    persistence: ArrayLike = 1.0,
    parameters: Parameters | None = None,
    formulation: Formulation = Formulation.RELEASED,
    fidelity: AbstractFidelity | None = None,
) -> RefreshTable:
    """For each velocity, the refresh rate and resolution that a budget buys most with.

    At refresh rate f a budget of B pixels a second leaves of each axis

    $$r = \\min(1, \\sqrt{B / (f R_x R_y)})$$

    Eq. 24 as printed asks for all of B to be spent; where B is more than every pixel of
    each frame, r is 1 and the rest is left. Candidates whose r would be below 1/4 are
    left out: no rate map is cheaper than 4x4 everywhere, so a frame of that refresh
    rate could not be shaded within the budget. Of candidates as good as each other
    the lowest refresh rate is taken: it has the sharper picture. With the released
    formulation quality ripples by up to 0.15 JND from one whole rate to the
    next, since its replicas lie on whole bins, and some rates are never the best.

    **Arguments:**

    - `spectrum`: of the whole picture, such as the first frame, which stands for what
        the eye follows. It is read at mip level 0; what coarse shading adds to that
        is part of the model.
    - `ppd` [px/deg], `luminance` [cd/m^2], `persistence` (0, 1], `resolution_px` (width
        and height): the display.
    - `pixels_per_second`: the budget B. [px/s], > 0.
    - `refresh_rates`: that the display can show, in any order: `every_rate(120, 30)`,
        or a list such as `(30, 60, 120)`. [Hz], > 0.
    - `velocities`: of the table's entries, in any order. [deg/s], >= 0.
    - `parameters`, `formulation`, `fidelity`: as for `camojab.quality`.

    **Returns:** the table. All 120 rates to 120 Hz and 61 velocities take 4 s in single
    precision on two cores, and 1 s with `Pooled(5000)`, which finds the same refresh
    rates for the authors' picture, with qualities within 0.004 JND.

    **Raises:** `ValueError` for an empty list, a value out of range, or a budget that
    does not suffice for 4x4 everywhere at the lowest of `refresh_rates`.

    **Source:** Jindal et al. (2021), Eq. 24.
    """
    asked = _Entries.of(refresh_rates, velocities, pixels_per_second, resolution_px)
    found = quality(
        spectrum,
        asked.display(ppd, luminance, persistence),
        asked.viewing,
        asked.shading,
        parameters,
        formulation=formulation,
        fidelity=fidelity,
    )
    return asked.table(found)


def refresh_table_denes2020(
    *,
    ppd: ArrayLike,
    pixels_per_second: float | int,
    resolution_px: tuple[int, int],
    refresh_rates: Numbers,
    velocities: Numbers,
    persistence: ArrayLike = 1.0,
    constants: Denes2020 | None = None,
) -> RefreshTable:
    """The same table as MARRR has it, which knows no content and no luminance.

    **Arguments:** as `refresh_table`; `constants`: `Denes2020.released()` if left out.

    **Returns, raises:** as `refresh_table`. Its qualities have a zero of their own.

    **Source:** Denes et al. (2020), ACM Trans. Graph. 39(4), Eq. 3 to 18, with the
    resolutions of Jindal et al. (2021), Eq. 24.
    """
    asked = _Entries.of(refresh_rates, velocities, pixels_per_second, resolution_px)
    # The model's constants hold for 100 cd/m^2 and it does not look at another.
    display = asked.display(ppd, 100.0, persistence)
    return asked.table(
        quality_denes2020(display, asked.viewing, asked.shading, constants)
    )


class _Entries(NamedTuple):
    """Velocities down and candidates across, for which quality is to be found."""

    velocity: Float[np.ndarray, " velocities"]
    refresh_rate: Float[np.ndarray, " rates"]
    resolution: Float[np.ndarray, " rates"]
    highest: float
    pixels_per_second: float | int

    @classmethod
    def of(
        cls,
        refresh_rates: Numbers,
        velocities: Numbers,
        pixels_per_second: float | int,
        resolution_px: tuple[int, int],
    ) -> "_Entries":
        positive, not_negative = (lambda x: x > 0), (lambda x: x >= 0)
        rates = sorted_numbers("refresh_rates", refresh_rates, positive, "> 0 Hz")
        speeds = sorted_numbers("velocities", velocities, not_negative, ">= 0 deg/s")
        affordable = _affordable(rates, pixels_per_second, resolution_px)
        return cls(speeds, *affordable, float(rates[-1]), pixels_per_second)

    def display(
        self, ppd: ArrayLike, luminance: ArrayLike, persistence: ArrayLike
    ) -> Display:
        return Display(
            ppd=ppd,
            refresh_rate=jnp.asarray(self.refresh_rate, float)[None, :],
            luminance=luminance,
            persistence=persistence,
        )

    @property
    def viewing(self) -> Viewing:
        return Viewing(jnp.asarray(self.velocity, float)[:, None])

    @property
    def shading(self) -> Shading:
        # A shape of its own: energies are pooled once for each resolution.
        side = jnp.asarray(self.resolution, float)[None, :]
        return Shading(rate_x=side, rate_y=side)

    def table(self, found: Float[Array, "velocities rates"]) -> RefreshTable:
        """The best candidate of each velocity; of equals the lowest."""
        same = lambda x: jnp.asarray(x, found.dtype)
        rates, resolution = same(self.refresh_rate), same(self.resolution)
        best = jnp.argmax(found, axis=1)
        return RefreshTable(
            velocity=same(self.velocity),
            refresh_rate=rates[best],
            resolution=resolution[best],
            quality=jnp.max(found, axis=1),
            candidates=rates,
            candidate_resolution=resolution,
            candidate_quality=found,
            highest=same(self.highest),
            pixels_per_second=same(self.pixels_per_second),
        )


def _affordable(
    rates: np.ndarray, pixels_per_second: float | int, resolution_px: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """The refresh rates at which 4x4 is within the budget, and what they leave."""
    width, height = resolution_px
    if min(width, height) < 1:
        raise ValueError(
            f"`resolution_px` must be a width and a height >= 1 px, got {width} x "
            f"{height}."
        )
    if not 0 < pixels_per_second < math.inf:
        raise ValueError(
            f"`pixels_per_second` must be > 0 px/s and finite, got "
            f"{shown(float(pixels_per_second))}."
        )
    resolution = np.sqrt(pixels_per_second / (rates * width * height))
    # A budget that is just 4x4 must not be lost to rounding.
    kept = resolution >= _COARSEST * (1 - 1e-9)
    if not kept.any():
        least = rates[0] * width * height * _COARSEST**2
        raise ValueError(
            f"`pixels_per_second` must be at least {shown(float(least))}, those of 4x4 "
            f"everywhere at {rates[0]:g} Hz, got {shown(float(pixels_per_second))}."
        )
    return rates[kept], np.clip(resolution[kept], _COARSEST, 1.0)


def sorted_numbers(
    name: str,
    values: Numbers,
    ok: Callable[[np.ndarray], np.ndarray],
    rule: str,
) -> np.ndarray:
    """Each of some numbers once, rising.

    **Raises:** `ValueError` naming the argument if there are none, or one is not `ok`.
    """
    array = np.asarray(values, float)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"`{name}` must be a list of numbers {rule}, got none.")
    bad = array[~(ok(array) & np.isfinite(array))]
    if bad.size:
        raise ValueError(
            f"`{name}` must be {rule} and finite, got {shown(float(bad[0]))}."
        )
    return np.unique(array)
