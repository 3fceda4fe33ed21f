"""What is shown, how it moves and how coarsely it is shaded; the units live here."""

import enum
import math
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, ArrayLike, Bool, Float

from ._errors import check, check_flag


class _Conditions(eqx.Module):
    """Named quantities with units; fields may have any shapes that broadcast."""

    UNITS: ClassVar[dict[str, str]] = {}

    def report(self) -> str:
        """One line to quote beside any number: every field, its value and its unit."""
        return ", ".join(
            f"{name}={brief(getattr(self, name))} [{unit}]"
            for name, unit in self.UNITS.items()
        )


def brief(x: Array, digits: int = 6) -> str:
    """A value, or the ends of many, for a report line."""
    if x.ndim == 0:
        return f"{float(x):.{digits}g}"
    return f"{float(x.min()):.{digits}g}..{float(x.max()):.{digits}g}"


class Display(_Conditions):
    """A flat display seen by an observer on its axis, with square pixels.

    Fields are arrays of any shapes that broadcast together, so one compiled model
    serves every display, and a whole set of displays goes through in one call.

    **Arguments:**

    - `ppd`: pixels per visual degree at the centre of the screen, twice the spatial
      Nyquist frequency. [px/deg], > 0.
    - `refresh_rate`: frames shown per second, twice the temporal Nyquist frequency.
      [Hz], > 0.
    - `luminance`: luminance that the observer is adapted to, taken as the mean
      luminance of the part of the image considered. [cd/m^2], > 0.
    - `persistence`: lit fraction of each frame. [1], in (0, 1].

    **Raises:** `ValueError` if a concrete value is out of range or not finite; under a
    JAX transformation the same sentence is raised at run time.

    **Source:** Jindal et al. 2021, Eq. 2.

    **Example:**

    >>> from camojab import Display
    >>> Display(ppd=60, refresh_rate=120, luminance=100).report()
    'ppd=60 [px/deg], refresh_rate=120 [Hz], luminance=100 [cd/m^2], persistence=1 [1]'
    """

    ppd: Float[Array, "..."]
    refresh_rate: Float[Array, "..."]
    luminance: Float[Array, "..."]
    persistence: Float[Array, "..."]

    UNITS: ClassVar[dict[str, str]] = {
        "ppd": "px/deg",
        "refresh_rate": "Hz",
        "luminance": "cd/m^2",
        "persistence": "1",
    }

    def __init__(
        self,
        *,
        ppd: ArrayLike,
        refresh_rate: ArrayLike,
        luminance: ArrayLike,
        persistence: ArrayLike = 1.0,
    ):
        self.ppd = check("ppd", ppd, _positive, "finite and > 0 px/deg")
        self.refresh_rate = check(
            "refresh_rate", refresh_rate, _positive, "finite and > 0 Hz"
        )
        self.luminance = check(
            "luminance", luminance, _positive, "finite and > 0 cd/m^2"
        )
        self.persistence = check("persistence", persistence, _unit, "in (0, 1]")

    @classmethod
    def from_geometry(
        cls,
        *,
        resolution_px: tuple[int, int],
        diagonal_m: float,
        distance_m: float,
        refresh_rate: ArrayLike,
        luminance: ArrayLike,
        persistence: ArrayLike = 1.0,
    ) -> "Display":
        """Derive `ppd` from a panel's pixels, its diagonal and the viewing distance.

        **Arguments:** `resolution_px`: width and height [px]; `diagonal_m` and
        `distance_m` [m], > 0; the rest as for `Display`.

        **Example:**

        >>> from camojab import Display
        >>> desk = dict(resolution_px=(2560, 1440), diagonal_m=0.68, distance_m=0.6)
        >>> display = Display.from_geometry(**desk, refresh_rate=144, luminance=100)
        >>> round(float(display.ppd), 2)  # [px/deg]
        45.23
        """
        for name, value in (("diagonal_m", diagonal_m), ("distance_m", distance_m)):
            if not 0 < value < math.inf:
                raise ValueError(f"`{name}` must be finite and > 0 m, got {value:g}.")
        if min(resolution_px) <= 0:
            raise ValueError(f"`resolution_px` must be > 0 px, got {resolution_px}.")
        pixel_m = diagonal_m / math.hypot(*resolution_px)
        ppd = 1.0 / math.degrees(2.0 * math.atan(pixel_m / (2.0 * distance_m)))
        return cls(
            ppd=ppd,
            refresh_rate=refresh_rate,
            luminance=luminance,
            persistence=persistence,
        )


class Viewing(_Conditions):
    """Image motion on the screen, horizontal, that the eye follows.

    **Arguments:** `velocity`: [deg/s], >= 0. Any shape.
    """

    velocity: Float[Array, "..."]

    UNITS: ClassVar[dict[str, str]] = {"velocity": "deg/s"}

    def __init__(self, velocity: ArrayLike):
        self.velocity = check(
            "velocity", velocity, _not_negative, "finite and >= 0 deg/s"
        )


class Shading(_Conditions):
    """How coarsely the texture is shaded, and the mip level read at full rate.

    A shading rate `m x n` (coarse pixels `m` wide and `n` high) is the shading
    resolution `rate_x = 1/m`, `rate_y = 1/n`.

    **Arguments:**

    - `rate_x`, `rate_y`: shading resolution along and across the motion. [1], in
      (0, 1].
    - `mip_level`: mip level selected at full rate, 0 the finest. [1], >= 0.

    **Source:** Jindal et al. 2021, Eq. 2 and 4.
    """

    rate_x: Float[Array, "..."]
    rate_y: Float[Array, "..."]
    mip_level: Float[Array, "..."]

    UNITS: ClassVar[dict[str, str]] = {"rate_x": "1", "rate_y": "1", "mip_level": "1"}

    def __init__(
        self,
        *,
        rate_x: ArrayLike = 1.0,
        rate_y: ArrayLike = 1.0,
        mip_level: ArrayLike = 0.0,
    ):
        self.rate_x = check("rate_x", rate_x, _unit, "in (0, 1]")
        self.rate_y = check("rate_y", rate_y, _unit, "in (0, 1]")
        self.mip_level = check("mip_level", mip_level, _not_negative, "finite and >= 0")


class LowPass(enum.Enum):
    """Transfer function that stands for a blur. All three fall alike from frequency 0.

    `LORENTZIAN` is the model's; `SINC` is the magnitude of the box blur's own, which
    the Lorentzian replaces; `GAUSSIAN` that of the normal blur of the same variance.
    """

    LORENTZIAN = "lorentzian"
    SINC = "sinc"
    GAUSSIAN = "gaussian"


class Components(eqx.Module):
    """Which parts of the model take part, for ablations.

    **Arguments:** (each but the last boolean, of any shape)

    - `vrs`: mipmap blur, replicas of coarse shading and the Nyquist crop.
    - `eye_blur`: hold-type blur and the blur of imperfect pursuit.
    - `judder`: the temporal distortion.
    - `low_pass`: of every blur.
    """

    vrs: Bool[Array, "..."]
    eye_blur: Bool[Array, "..."]
    judder: Bool[Array, "..."]
    low_pass: LowPass = eqx.field(static=True)

    def __init__(
        self,
        *,
        vrs: ArrayLike = True,
        eye_blur: ArrayLike = True,
        judder: ArrayLike = True,
        low_pass: LowPass = LowPass.LORENTZIAN,
    ):
        self.vrs = check_flag("vrs", vrs)
        self.eye_blur = check_flag("eye_blur", eye_blur)
        self.judder = check_flag("judder", judder)
        self.low_pass = LowPass(low_pass)


def _positive(x: Array) -> Array:
    return (x > 0) & (x < math.inf)


def _not_negative(x: Array) -> Array:
    return (x >= 0) & (x < math.inf)


def _unit(x: Array) -> Array:
    return (x > 0) & (x <= 1)
