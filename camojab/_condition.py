"""Everything but the texture that one evaluation of the model depends on."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._csf import log_sensitivity
from ._display import Components, Display, Shading, Viewing
from ._filters import LOG_TRANSFER
from ._parameters import Parameters


class Condition(eqx.Module):
    """One evaluation of the model, or many: one array a field."""

    display: Display
    viewing: Viewing
    shading: Shading
    components: Components
    parameters: Parameters


def flattened(condition: Condition, dtype) -> tuple[tuple[int, ...], Condition]:
    """The conditions' common shape, and every field as one axis of that length."""
    leaves, structure = jax.tree.flatten(condition)
    shape = common_shape(condition)
    leaves = [
        jnp.broadcast_to(leaf, shape)
        .reshape(math.prod(shape))
        .astype(bool if leaf.dtype == bool else dtype)
        for leaf in leaves
    ]
    return shape, jax.tree.unflatten(structure, leaves)


def common_shape(condition: Condition) -> tuple[int, ...]:
    """The shape that all fields broadcast to.

    **Raises:** `ValueError` if there is none.
    """
    shapes = {leaf.shape for leaf in jax.tree.leaves(condition)}
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        raise ValueError(
            "the shapes of the conditions must broadcast together, got "
            f"{sorted(shape for shape in shapes if shape)}."
        ) from error


def log_eye_blur(rho: Float[Array, " n"], c: Condition) -> Float[Array, " n"]:
    """Log transfer of hold-type and pursuit blur along the motion (Eq. 14 to 18)."""
    velocity, persistence, p = c.viewing.velocity, c.display.persistence, c.parameters
    hold = p.hold_width * persistence * velocity / c.display.refresh_rate
    pursuit = p.pursuit_width * persistence * (p.ca * velocity + p.cb)
    log_low_pass = LOG_TRANSFER[c.components.low_pass]
    log_transfer = log_low_pass(rho, hold) + log_low_pass(rho, pursuit)
    return jnp.where(c.components.eye_blur, log_transfer, 0)


class Terms(eqx.Module):
    """Which terms were evaluated, in the shape of the conditions.

    A term is left out only where it could not change the result by more than a
    rounding error: no coarse shading where `Components` leaves it out, no `eye_blur`
    where it passes all that the display shows, no `judder` where the temporal replica
    lies wholly beyond the spectrum. `band` is the highest frequency on whose bins the
    shaded spectrum was evaluated, 256 for all: coarse shading leaves none beyond.
    [bins].
    """

    vrs: Bool[Array, "..."]
    eye_blur: Bool[Array, "..."]
    judder: Bool[Array, "..."]
    band: Int[Array, "..."]


def terms_within(
    c: Condition,
    reach: Float[Array, ""],
    replica: Float[Array, ""],
    band: Int[Array, ""],
) -> Terms:
    """The terms that matter; `reach` is the last place where a replica does. [bins]."""
    nyquist = 0.5 * c.display.ppd
    most = -c.parameters.beta * log_eye_blur(nyquist[None], c)[0]
    negligible = float(jnp.finfo(nyquist.dtype).eps) ** 2
    return Terms(
        vrs=c.components.vrs,
        eye_blur=c.components.eye_blur & (most >= negligible),
        judder=c.components.judder & (replica <= reach),
        band=band,
    )


class Field(eqx.Module):
    """Amplitudes whose weighted powers make an energy: sum(weight exp(beta log)).

    - `log`: natural logarithm of amplitude times sensitivity, `-inf` where zero.
    - `weight`: of each in the energy; >= 0.
    """

    log: Float[Array, "rows columns"]
    weight: Float[Array, "rows columns"]


def sensitivity_power(
    rho: Float[Array, "*n"],
    temporal_frequency: Float[Array, ""],
    at_zero: float,
    c: Condition,
) -> Float[Array, "*n"]:
    """`sensitivity ** beta`, with the given value at spatial frequency 0."""
    log = log_sensitivity_of(rho, temporal_frequency, c)
    return jnp.where(rho > 0, jnp.exp(c.parameters.beta * log), at_zero)


def log_sensitivity_of(
    rho: Float[Array, "*n"], temporal_frequency: Float[Array, ""], c: Condition
) -> Float[Array, "*n"]:
    """Logarithm of the sensitivity, finite and of no meaning at frequency 0."""
    p = c.parameters
    gains = (p.achromatic_gain, p.red_green_gain, p.yellow_violet_gain, p.velocity_gain)
    return log_sensitivity(
        jnp.where(rho > 0, rho, 1),
        jnp.broadcast_to(temporal_frequency, rho.shape),
        jnp.broadcast_to(c.display.luminance, rho.shape),
        tuple(jnp.log(gain) for gain in gains),
    )
