"""The errors of all seven rates from those of a few."""

import functools

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._rates import RATES


HALVING = 2.13
"""How much larger the error is when a shading rate is halved on both axes."""

# Each follows from those before it (Eq. 10): of the first the larger, of the second
# `HALVING` times as much, where there is one.
_FOLLOWS = {
    "2x2": (("1x2", "2x1"), None),
    "2x4": (("2x2",), "1x2"),
    "4x2": (("2x2",), "2x1"),
    "4x4": (("2x4", "4x2"), None),
}


def extrapolate(
    values: Float[Array, "outputs rows columns"], rates: tuple[str, ...]
) -> Float[Array, "7 rows columns"]:
    """Errors at all seven rates (Eq. 10) from those of two or four.

    A square rate is the larger of the two that have half as many invocations; 2x4 is
    the larger of 2x2 and 2.13 times 1x2, and 4x2 likewise. In the paper u x v is
    horizontal x vertical, which is width x height of the coarse pixel as everywhere
    here. Rates that are given stay as they are: with 2x4 and 4x2 among them only 2x2
    and 4x4 are made up, which the paper found to be the better of the two ways.

    The factor was derived for errors, so these must be errors in the metric's own unit
    (`MetricNetwork.predict`, then `as_error`) and not transformed: there the factor
    would mean something else for every transform, and nothing near its upper end.

    **Arguments:**

    - `values`: error at each of `rates`. [unit of the metric], 0 = none, larger is
        worse.
    - `rates`: names, with 1x2 and 2x1 among them.

    **Returns:** errors in the order of `alsarr.RATES`; that of 1x1 is 0.

    **Raises:** `ValueError` if names are unknown, double or do not match `values`, or
    without 1x2 and 2x1.

    **Source:** Cardoso et al. 2022, Eq. 10, with k of Yang et al. 2019.
    """
    known = set(RATES.names[:-1])
    if not {"1x2", "2x1"} <= set(rates) <= known or len(set(rates)) < len(rates):
        raise ValueError(
            "`rates` must be 1x2, 2x1 and others of "
            f"{', '.join(RATES.names[:-1])}, each once, got {', '.join(rates)}."
        )
    if values.shape[0] != len(rates):
        raise ValueError(
            f"`values` must have one entry for each of {len(rates)} rates, got "
            f"{values.shape[0]}."
        )
    error = dict(zip(rates, values, strict=True))
    for name, (coarser_than, halved) in _FOLLOWS.items():
        if name not in error:
            parts = [error[other] for other in coarser_than]
            if halved is not None:
                parts.append(HALVING * error[halved])
            error[name] = functools.reduce(jnp.maximum, parts)
    error["1x1"] = jnp.zeros_like(values[0])
    return jnp.stack([error[name] for name in RATES.names])


def as_error(values: Float[Array, "*n"], metric: str) -> Float[Array, "*n"]:
    """The metric as an error: 0 where there is none, larger is worse.

    PSNR in dB becomes the root of the mean square error, 10^(-PSNR/20), of which white
    is 1; the other metrics are errors already.
    """
    return 10.0 ** (-values / 20.0) if metric == "psnr" else values
