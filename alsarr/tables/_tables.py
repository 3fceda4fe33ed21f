"""Tables of polynomials, and how a tile is looked up in them."""

from abc import abstractmethod
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._rates import nearest_finer, RATES
from ._basis import AbstractBasis
from ._blocks import in_blocks
from ._certificate import Certificate
from ._domain import clipped, Conditions, Domain
from ._rate_order import check_rates, SIDES


class AbstractTables(eqx.Module, strict=True):
    """Polynomials that give the quality of every shading rate under given conditions.

    Tables know textures, conditions and polynomials; a frame is looked up in them by
    `alsarr.oracle.TableOracle`. All arrays of the methods have one entry a tile and
    the floating dtype of the coefficients:

    - `texture`: index into the tables. In [0, `num_textures`).
    - `mip_level`: [octaves], >= 0. The nearest level of the tables is used, the
        finer of two.
    - `velocity_x`, `velocity_y`: [deg/s], >= 0.
    - `luminance`: [cd/m^2], >= 0.
    - `refresh_rate`: one number for all. [Hz], > 0.
    """

    @property
    @abstractmethod
    def num_textures(self) -> int:
        """How many textures the tables hold."""

    @property
    @abstractmethod
    def dtype(self) -> jnp.dtype:
        """Floating dtype of the coefficients, and so of the qualities."""

    @abstractmethod
    def holds(self, texture: Int[Array, " tiles"]) -> Bool[Array, " tiles"]:
        """Whether there are polynomials of a texture. Any index >= 0."""

    @abstractmethod
    def quality(
        self,
        texture: Int[Array, " tiles"],
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Float[Array, "tiles 7"]:
        """Quality of each rate, in the order of `alsarr.RATES`. [JND]"""

    @abstractmethod
    def outside(
        self,
        texture: Int[Array, " tiles"],
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Bool[Array, " tiles"]:
        """Whether the tables were not fitted to such conditions."""


class QualityTables(AbstractTables, strict=True):
    """A polynomial for every texture, mip level, shading rate and direction of motion.

    Direction 0 is motion in x over the texture as it is; direction 1 is motion in y,
    that is motion in x over the transposed texture with the sides of the coarse pixel
    swapped (Eq. 28); where there is one direction it stands for both. The quality of a
    tile is the mean of both (Eq. 29), relative to shading the same texture under the
    same condition at the rate `relative_to`. A rate that is not in `rates` has the
    quality of the nearest finer one.

    Conditions outside `domain` are moved to its edge, and a pair of texture and mip
    level that does not occur becomes the nearest level of the texture that does;
    `outside` tells which.

    - `coefficients`: of each entry, in the units of `basis`.
    - `entry`: of each texture at each of `mip_levels`, as an index into the entries; -1
      for all levels of a texture that does not occur.
    - `occurs`: whether an entry was made for that pair itself.
    - `constant`: whether an entry is one number for all rates and conditions.
    - `mip_levels`: the levels of the second axis of `entry`, rising. [octaves]
    - `domain`: the conditions that the tables are good for.
    - `certificate`: of their errors.
    - `basis`: that the polynomials belong to.
    - `rates`: some of `alsarr.RATES`, or the coarse pixel's side along the motion,
      `("4", "2", "1")`, for separable tables.
    - `texture_names`: one name a texture.
    - `model`: one line that says which model and display the qualities come from.
    - `relative_to`: name of the rate whose quality is 0; `None` where qualities are the
      model's own.
    - `tolerance_jnd`: that was asked for; `None` where none was. See `meets`.

    **Raises:** `ValueError` if shapes do not match the names, levels and rates, if the
    levels do not rise, or an entry is out of range.

    **Source:** Jindal et al. (2021), ACM Trans. Graph. 40(6), Eqs. 28, 29 and 31.
    """

    coefficients: Float[Array, "entries rates directions coefficients"]
    entry: Int[Array, "textures mips"]
    occurs: Bool[Array, "textures mips"]
    constant: Bool[Array, " entries"]
    mip_levels: Float[Array, " mips"]
    domain: Domain
    certificate: Certificate
    basis: AbstractBasis
    rates: tuple[str, ...] = eqx.field(static=True)
    texture_names: tuple[str, ...] = eqx.field(static=True)
    model: str = eqx.field(static=True)
    relative_to: str | None = eqx.field(static=True)
    tolerance_jnd: float | None = eqx.field(static=True)

    def __init__(
        self,
        *,
        coefficients: ArrayLike,
        entry: ArrayLike,
        occurs: ArrayLike,
        constant: ArrayLike,
        mip_levels: tuple[float | int, ...],
        domain: Domain,
        certificate: Certificate,
        basis: AbstractBasis,
        texture_names: tuple[str, ...],
        model: str,
        rates: tuple[str, ...] = RATES.names,
        relative_to: str | None = "4x4",
        tolerance_jnd: float | None = None,
    ):
        dtype = jnp.result_type(float)
        self.coefficients = jnp.asarray(coefficients, dtype)
        self.entry = jnp.asarray(entry, jnp.int32)
        self.occurs = jnp.asarray(occurs, bool)
        self.constant = jnp.asarray(constant, bool)
        self.mip_levels = jnp.asarray(mip_levels, dtype)
        self.domain = domain
        self.certificate = certificate
        self.basis = basis
        self.rates = rates
        self.texture_names = texture_names
        self.model = model
        self.relative_to = relative_to
        self.tolerance_jnd = tolerance_jnd
        check_rates(rates)
        if sorted(set(mip_levels)) != list(mip_levels) or not mip_levels:
            raise ValueError(
                f"`mip_levels` must be one or more, rising, got {mip_levels}."
            )
        if relative_to not in (*rates, None):
            raise ValueError(
                f"`relative_to` must be one of {', '.join(rates)} or None, got "
                f"{relative_to!r}."
            )
        self._check_shapes()

    def _check_shapes(self) -> None:
        entries, directions = self.constant.size, self.coefficients.shape[2:3]
        records = (entries, len(self.rates), *directions)
        pairs = (len(self.texture_names), self.mip_levels.size)
        expected = {
            "coefficients": (*records, self.basis.num_coefficients),
            "entry": pairs,
            "occurs": pairs,
        }
        of = {name: getattr(self, name).shape for name in expected}
        errors = ("largest", "percentile_99", "median")
        expected |= {f"certificate.{name}": records for name in errors}
        of |= {f"certificate.{n}": getattr(self.certificate, n).shape for n in errors}
        for name, shape in expected.items():
            if of[name] != shape or directions not in ((1,), (2,)):
                raise ValueError(
                    f"`{name}` must have shape {shape} to match the names, levels, "
                    f"rates and basis, got {of[name]}."
                )
        entry = np.asarray(self.entry)
        if entry.min() < -1 or entry.max() >= entries:
            raise ValueError(
                f"`entry` must be from -1 to {entries - 1}, got {entry.min()} to "
                f"{entry.max()}."
            )

    @property
    def num_textures(self) -> int:
        return len(self.texture_names)

    @property
    def dtype(self) -> jnp.dtype:
        return self.coefficients.dtype

    @property
    def largest_error(self) -> Float[Array, ""]:
        """Over the held-out conditions of all polynomials. [JND]."""
        return self.certificate.overall[0]

    @property
    def median_error(self) -> Float[Array, ""]:
        """Over the held-out conditions of all polynomials. [JND]."""
        return self.certificate.overall[2]

    @property
    def meets(self) -> bool | None:
        """Whether the largest error is within `tolerance_jnd`; `None` without one."""
        if self.tolerance_jnd is None:
            return None
        return bool(self.largest_error <= self.tolerance_jnd)

    @property
    def count(self) -> int:
        """Numbers that the polynomials take; a constant takes one."""
        constants = int(np.sum(np.asarray(self.constant)))
        each = int(np.prod(self.coefficients.shape[1:]))
        return (self.constant.size - constants) * each + constants

    def holds(self, texture: Int[Array, " tiles"]) -> Bool[Array, " tiles"]:
        """See `AbstractTables.holds`."""
        return (texture < self.num_textures) & (self.entry[texture, 0] >= 0)

    def quality(
        self,
        texture: Int[Array, " tiles"],
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Float[Array, "tiles 7"]:
        """See `AbstractTables.quality`. Differentiable in all but the indices.

        NaN for a texture that does not occur.
        """

        def of(texture, mip_level, velocity_x, velocity_y, luminance):
            entry = self.entry[texture, self._level(mip_level)]
            velocity = jnp.stack([velocity_x, velocity_y], axis=1)[:, None, :]
            at = Conditions(
                velocity,
                refresh_rate[None, None, None],
                jnp.log10(jnp.clip(luminance, *self.domain.luminance))[:, None, None],
            )
            found = self.basis.evaluate(
                self.coefficients[entry], clipped(at, self.domain), self.domain
            )
            x, y = _places(self.rates)
            both = (found[:, x, 0] + found[:, y, 1]) / 2
            return jnp.where(entry[:, None] < 0, jnp.nan, both)

        return in_blocks(of, texture, mip_level, velocity_x, velocity_y, luminance)

    def outside(
        self,
        texture: Int[Array, " tiles"],
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Bool[Array, " tiles"]:
        """See `AbstractTables.outside`. The qualities of these tiles are those of the
        nearest condition and level inside."""
        domain, levels = self.domain, self.mip_levels
        return (
            # What lies half way is nearest to the finer level.
            (mip_level <= levels[0] - 0.5)
            | (mip_level > levels[-1] + 0.5)
            | ~self.occurs[texture, self._level(mip_level)]
            | _is_outside(velocity_x, domain.velocity)
            | _is_outside(velocity_y, domain.velocity)
            | _is_outside(luminance, domain.luminance)
            | _is_outside(refresh_rate, domain.refresh_rate)
        )

    def polynomial(
        self, texture: str, mip_level: Float[Array, " n"]
    ) -> Float[Array, "n rates directions coefficients"]:
        """Coefficients of a texture at the nearest mip levels. [octaves]."""
        entry = self.entry[self.texture_names.index(texture)]
        return self.coefficients[entry[self._level(mip_level)]]

    def dense(self) -> Float[np.ndarray, "directions textures mips rates coefficients"]:
        """Every texture at every whole level from 0 to the highest, for engines.

        A level that the tables do not have is the nearest one; a texture that does not
        occur is 0 everywhere. In single precision.

        **Raises:** `ValueError` if a level is no whole number.
        """
        levels = np.asarray(self.mip_levels)
        if np.any(levels != np.round(levels)):
            raise ValueError(
                f"`mip_levels` must be whole numbers, got {levels.tolist()}."
            )
        every = jnp.arange(levels[-1] + 1, dtype=self.dtype)
        entry = np.asarray(self.entry)[:, np.asarray(self._level(every))]
        found = np.asarray(self.coefficients, np.float32)[entry]
        found = np.where(entry[..., None, None, None] < 0, np.float32(0), found)
        return np.moveaxis(found, 3, 0)

    def _level(self, mip_level: Float[Array, " tiles"]) -> Int[Array, " tiles"]:
        """Index of the nearest level, the finer of two."""
        return jnp.argmin(jnp.abs(self.mip_levels[:, None] - mip_level[None]), axis=0)


def index_entries(
    num_textures: int,
    mip_levels: Sequence[float],
    owners: Sequence[tuple[int, tuple[float, ...]]],
) -> tuple[Int[np.ndarray, "textures mips"], Bool[np.ndarray, "textures mips"]]:
    """The entry of every texture and level, and whether one was made for that pair.

    **Arguments:** `owners`: texture and mip levels that each entry was made for.

    **Raises:** `ValueError` for a level that is not one of `mip_levels`, a texture out
    of range, a pair with two entries, or an entry of no level.
    """
    levels = np.array(mip_levels, float)
    made = {}
    for i, (texture, own) in enumerate(owners):
        if not (own and 0 <= texture < num_textures):
            raise ValueError(
                f"`entries` must each have a mip level and one of {num_textures} "
                f"textures, got {texture} at {own}."
            )
        for level in own:
            if (texture, level) in made or level not in levels:
                raise ValueError(
                    "`entries` must have one entry for a texture and one of the mip "
                    f"levels, got {texture} at {level:g}."
                )
            made[texture, level] = i
    entry = np.full((num_textures, levels.size), -1)
    for texture in range(num_textures):
        own = np.array(sorted(level for t, level in made if t == texture))
        if own.size:
            nearest = own[np.abs(own[:, None] - levels).argmin(axis=0)]
            entry[texture] = [made[texture, level] for level in nearest.tolist()]
    pairs = [[(t, level) in made for level in levels] for t in range(num_textures)]
    return entry, np.array(pairs)


def _places(rates: tuple[str, ...]) -> Int[np.ndarray, "2 7"]:
    """Where the seven rates are in a table's, for the motion in x and in y."""
    if rates == SIDES:
        return np.array([[rates.index(str(m)) for m in side] for side in RATES.size.T])
    held = nearest_finer(rates)
    place = [rates.index(RATES.names[k]) for k in held]
    return np.array([place, place])


def _is_outside(x: Float[Array, "*n"], ends: Float[Array, "2"]) -> Bool[Array, "*n"]:
    """Rounding of the ends themselves, as in 10^log10(L), does not count."""
    slack = 8 * jnp.finfo(ends.dtype).eps * jnp.max(jnp.abs(ends))
    return (x < ends[0] - slack) | (x > ends[1] + slack)
