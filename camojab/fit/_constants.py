"""What may be fitted, and how a vector of real numbers stands for it."""

import math
from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._parameters import Parameters, UNITS


# Where a search for the lapse rate begins.
_LAPSE = 0.02
_NEGATIVE = ("ws", "wt")


class Constants(eqx.Module):
    """All constants of a fit, of which those in `free` are sought.

    A point of the search has the logarithm of the magnitude of each free constant, and
    the log odds of the lapse rate, so that every point is a valid model.

    - `scale`: factor of each data set. `scale:NAME` is its name in `free`.
    - `lapse`: probability that an observer guesses.
    """

    parameters: Parameters
    scale: Float[Array, " sets"]
    lapse: Float[Array, ""]
    free: tuple[str, ...] = eqx.field(static=True)
    data_sets: tuple[str, ...] = eqx.field(static=True)

    def values(self) -> Float[Array, " free"]:
        """The free constants, in the units of `units`."""
        return jnp.stack([self._value(name) for name in self.free])

    def point(self) -> Float[Array, " free"]:
        """Where these constants stand in the space of the search."""
        value = jnp.abs(self.values())
        odds = value / jnp.where(self._is_lapse(), 1 - value, 1)
        return jnp.log(odds)

    def at(self, point: Float[Array, " free"]) -> "Constants":
        """These constants with the free ones of a point of the search."""
        sign = jnp.array([-1.0 if n in _NEGATIVE else 1.0 for n in self.free])
        values = jnp.where(
            self._is_lapse(),
            jax.nn.sigmoid(point),
            sign.astype(point.dtype) * jnp.exp(point),
        )
        where = lambda c: [getattr(c.parameters, n) for n in self.free if n in UNITS]
        own = [v for v, name in zip(values, self.free, strict=True) if name in UNITS]
        changed = eqx.tree_at(where, self, own) if own else self
        for value, name in zip(values, self.free, strict=True):
            if name == "lapse":
                changed = eqx.tree_at(lambda c: c.lapse, changed, value)
            elif name not in UNITS:
                scale = changed.scale.at[self._data_set(name)].set(value)
                changed = eqx.tree_at(lambda c: c.scale, changed, scale)
        return changed

    def freed(self, free: Sequence[str]) -> "Constants":
        """The same constants, of which others are sought."""
        where = (self.parameters, self.scale, self.lapse)
        return Constants(*where, tuple(free), self.data_sets)

    def slope(self) -> Float[Array, " free"]:
        """Derivative of each value along its coordinate of the search."""
        values = self.values()
        return jnp.where(self._is_lapse(), values * (1 - values), values)

    def units(self) -> dict[str, str]:
        """The unit of each free constant."""
        return {name: UNITS.get(name, "1") for name in self.free}

    def model(self) -> tuple[str, ...]:
        """Those of the free constants that the distortions depend on."""
        weights = ("ws", "wt")
        return tuple(n for n in self.free if n in UNITS and n not in weights)

    def _value(self, name: str) -> Float[Array, ""]:
        if name in UNITS:
            return getattr(self.parameters, name)
        return self.lapse if name == "lapse" else self.scale[self._data_set(name)]

    def _data_set(self, name: str) -> int:
        return self.data_sets.index(name.removeprefix("scale:"))

    def _is_lapse(self) -> np.ndarray:
        return np.array([name == "lapse" for name in self.free])


def constants(
    free: Iterable[str],
    data_sets: Sequence[str],
    start: Parameters,
    scales: Mapping[str, float] | None = None,
) -> Constants:
    """The constants that a search starts from; a scale that is not given starts at 1.

    `"scales"` stands for those of all data sets but the first, in whose scale the
    others are expressed.

    **Raises:** `ValueError` for a name that is not known or is there twice, or a start
    from which a constant cannot move.
    """
    names: list[str] = []
    for name in free:
        names += [f"scale:{s}" for s in data_sets[1:]] if name == "scales" else [name]
    _check(names, data_sets, start)
    scales = scales or {}
    for name, value in scales.items():
        if name not in data_sets:
            shown = ", ".join(data_sets)
            raise ValueError(f"`scales` must be of {shown}, got {name!r}.")
        if not 0 < value < math.inf:
            raise ValueError(f"`scales` must be finite and > 0, got {value:g}.")
    dtype = start.beta.dtype
    lapse = _LAPSE if "lapse" in names else 0.0
    return Constants(
        start,
        jnp.asarray([scales.get(name, 1.0) for name in data_sets], dtype),
        jnp.asarray(lapse, dtype),
        tuple(names),
        tuple(data_sets),
    )


def _check(names: Sequence[str], data_sets: Sequence[str], start: Parameters) -> None:
    known = (*UNITS, "lapse", "scales", *(f"scale:{s}" for s in data_sets))
    for name in names:
        if name not in known:
            shown = ", ".join(known)
            raise ValueError(f"`free` must be of {shown}, got {name!r}.")
        if names.count(name) > 1:
            raise ValueError(
                f"`free` must have each constant once, got {name!r} twice."
            )
        if name in UNITS:
            value, sign = float(getattr(start, name)), "> 0"
            if name in _NEGATIVE:
                value, sign = -value, "negative"
            if not value > 0:
                raise ValueError(
                    f"`start.{name}` must be {sign} to be fitted, got "
                    f"{float(getattr(start, name)):g}."
                )
    if not names:
        raise ValueError("`free` must name at least one constant, got none.")
