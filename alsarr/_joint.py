"""What motion alone costs a frame at every refresh rate, for choosing one with it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from camojab import (
    Display,
    Formulation,
    Parameters,
    quality,
    Spectrum,
    Viewing,
)
from camojab._fidelity import AbstractFidelity

from ._refresh import Numbers, sorted_numbers


class JointRefresh(eqx.Module, strict=True):
    """Quality of a moving picture at full shading rate, by velocity and refresh rate.

    Hold-type blur and judder belong to the refresh rate, coarse shading to the rate
    map. Quality of a frame is the sum of what its tiles lose by their shading rates, on
    average, and of this, which is counted once for the frame and not once for every
    tile. Made by `joint_refresh`.

    - `velocity`: of the entries, rising. [deg/s]
    - `candidates`: refresh rates to choose from, rising. [Hz]
    - `quality`: of the whole picture at full rate. [JND]
    """

    velocity: Float[Array, " velocities"]
    candidates: Float[Array, " rates"]
    quality: Float[Array, "velocities rates"]

    def at(self, velocity: Float[Array, ""]) -> Float[Array, " rates"]:
        """Quality at every candidate, linear between entries, constant beyond. [JND]"""
        v = velocity.astype(self.velocity.dtype)
        each = lambda column: jnp.interp(v, self.velocity, column)
        return jax.vmap(each)(self.quality.T)


def joint_refresh(
    spectrum: Spectrum,
    *,
    ppd: ArrayLike,
    luminance: ArrayLike,
    refresh_rates: Numbers,
    velocities: Numbers,
    persistence: ArrayLike = 1.0,
    parameters: Parameters | None = None,
    formulation: Formulation = Formulation.RELEASED,
    fidelity: AbstractFidelity | None = None,
) -> JointRefresh:
    """Evaluate the model on a whole picture at full rate, for `JointRefresh`.

    **Arguments, raises:** as `refresh_table`, which knows a budget besides.

    **Source:** the quality of Jindal et al. (2021), Eq. 24, at full resolution.
    """
    rates = sorted_numbers("refresh_rates", refresh_rates, lambda x: x > 0, "> 0 Hz")
    speeds = sorted_numbers("velocities", velocities, lambda x: x >= 0, ">= 0 deg/s")
    found = quality(
        spectrum,
        Display(
            ppd=ppd,
            refresh_rate=jnp.asarray(rates, float)[None, :],
            luminance=luminance,
            persistence=persistence,
        ),
        Viewing(jnp.asarray(speeds, float)[:, None]),
        parameters=parameters,
        formulation=formulation,
        fidelity=fidelity,
    )
    same = lambda x: jnp.asarray(x, found.dtype)
    return JointRefresh(same(speeds), same(rates), found)
