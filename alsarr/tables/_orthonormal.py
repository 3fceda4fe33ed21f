"""Bases that are orthonormal over samples, whatever these determine."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Orthonormal(eqx.Module, strict=True):
    """Orthonormal combinations of monomials over the samples.

    Directions that the samples do not determine are zero columns in both arrays and 0
    in `determined`.
    """

    values: Float[Array, "n terms"]
    to_monomials: Float[Array, "terms terms"]
    determined: Float[Array, " terms"]


def orthonormal(monomials: Float[Array, "n terms"]) -> Orthonormal:
    n, terms = monomials.shape
    if n < terms:
        monomials = jnp.pad(monomials, ((0, terms - n), (0, 0)))
    u, s, vt = jnp.linalg.svd(monomials, full_matrices=False)
    cut = s[0] * max(n, terms) * jnp.finfo(s.dtype).eps
    determined = s > cut
    values = jnp.where(determined[None, :], u[:n], 0)
    to_monomials = (
        jnp.where(determined, 1 / jnp.where(determined, s, 1), 0)[None] * vt.T
    )
    return Orthonormal(values, to_monomials, determined.astype(s.dtype))
