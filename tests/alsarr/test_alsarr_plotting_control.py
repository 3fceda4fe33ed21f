"""Figures of refresh rates have names with units on every axis."""

import io

import jax.numpy as jnp

from alsarr import RefreshTable
from alsarr.plotting import refresh_rates


def table():
    """Two velocities, and two refresh rates to choose from."""
    return RefreshTable(
        velocity=jnp.array([0.0, 10.0]),
        refresh_rate=jnp.array([60.0, 120.0]),
        resolution=jnp.array([0.7, 0.5]),
        quality=jnp.array([-1.0, -2.0]),
        candidates=jnp.array([60.0, 120.0]),
        candidate_resolution=jnp.array([0.7, 0.5]),
        candidate_quality=jnp.array([[-1.0, -1.5], [-3.0, -2.0]]),
        highest=jnp.asarray(120.0),
        pixels_per_second=jnp.asarray(1e8),
    )


def test_every_axis_has_a_name_and_a_unit():
    figure = refresh_rates({"one": table()})
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    assert [(a.get_xlabel(), a.get_ylabel()) for a in figure.axes] == [
        ("refresh rate [Hz]", "quality [JND]"),
        ("velocity [deg/s]", "best refresh rate [Hz]"),
        ("velocity [deg/s]", "shading resolution of each axis [1]"),
    ]
