"""What is shown: accepted values, units, and errors in Python and inside jit."""

import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab import (
    Components,
    Display,
    Parameters,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


DISPLAY = {"ppd": 60.0, "refresh_rate": 60.0, "luminance": 100.0, "persistence": 0.5}
SHADING = {"rate_x": 0.5, "rate_y": 0.5, "mip_level": 1.0}
PARAMETERS = {"ws": -3.7, "wt": -2.9, "beta": 0.36, "ca": 0.001, "cb": 0.08}

MAKE = {
    **{name: lambda **x: Display(**DISPLAY | x) for name in DISPLAY},
    "velocity": lambda **x: Viewing(**x),
    **{name: lambda **x: Shading(**SHADING | x) for name in SHADING},
    **{name: lambda **x: Parameters(**PARAMETERS | x) for name in PARAMETERS},
}

RULES = {
    "ppd": "finite and > 0 px/deg",
    "refresh_rate": "finite and > 0 Hz",
    "luminance": "finite and > 0 cd/m^2",
    "persistence": "in (0, 1]",
    "velocity": "finite and >= 0 deg/s",
    "rate_x": "in (0, 1]",
    "rate_y": "in (0, 1]",
    "mip_level": "finite and >= 0",
    "ws": "finite [JND]",
    "wt": "finite [JND]",
    "beta": "finite, > 0",
    "ca": "finite, >= 0 s",
    "cb": "finite, >= 0 deg",
}

NOT_FINITE = [(np.nan, "nan"), (np.inf, "inf"), (-np.inf, "-inf")]
BAD = [
    *((name, *bad) for name in RULES for bad in NOT_FINITE),
    *((name, -2.5, "-2.5") for name in RULES if name not in ("ws", "wt")),
    *(
        (name, 0.0, "0")
        for name in (
            "ppd",
            "refresh_rate",
            "luminance",
            "persistence",
            "rate_x",
            "rate_y",
            "beta",
        )
    ),
    *((name, 1.5, "1.5") for name in ("persistence", "rate_x", "rate_y")),
]


@pytest.mark.parametrize("name, value, shown", BAD)
def test_errors(name, value, shown):
    with pytest.raises(ValueError) as error:
        MAKE[name](**{name: value})
    assert str(error.value) == f"`{name}` must be {RULES[name]}, got {shown}."


@pytest.mark.parametrize("name", list(RULES))
def test_errors_inside_jit(name):
    make = eqx.filter_jit(lambda value: MAKE[name](**{name: value}))
    make(jnp.asarray(0.5))
    for value, _ in NOT_FINITE:
        with pytest.raises(RuntimeError) as error:
            make(jnp.asarray(value))
        assert f"`{name}` must be {RULES[name]}." in str(error.value)


def test_an_error_deep_inside_a_jitted_quality():
    spectrum = Spectrum.from_texture(np.ones((2, 2)))

    @eqx.filter_jit
    def of(velocity, persistence):
        display = Display(**DISPLAY | {"persistence": persistence})
        return quality(spectrum, display, Viewing(velocity))

    of(jnp.asarray(10.0), jnp.asarray(0.5))
    with pytest.raises(RuntimeError, match=r"`velocity` must be finite and >= 0"):
        of(jnp.asarray(-1.0), jnp.asarray(0.5))
    with pytest.raises(RuntimeError, match=r"`persistence` must be in \(0, 1\]"):
        of(jnp.asarray(10.0), jnp.asarray(0.0))


def test_constants_are_checked_inside_jit():
    low, high = jnp.asarray(-1.0), jnp.asarray(1.0)
    with_constant = lambda c: eqx.filter_jit(lambda x: Viewing(c).velocity + x)(1.0)
    assert with_constant(high) == with_constant(1.0) == 2
    for constant in (low, -1.0):
        with pytest.raises(RuntimeError, match="`velocity` must be finite and >= 0"):
            with_constant(constant)


def test_errors_inside_vmap():
    display = jax.vmap(lambda v: Display(**DISPLAY | {"ppd": v}))
    with pytest.raises(RuntimeError, match="`ppd` must be finite and > 0 px/deg"):
        jax.block_until_ready(eqx.filter_jit(display)(jnp.array([1.0, -1.0, 2.0])))


def test_one_bad_value_of_many_is_shown():
    with pytest.raises(ValueError, match=r"^`rate_x` must be .*, got 3\.$"):
        Shading(rate_x=np.array([[0.5, 0.25], [3.0, 1.0]]))


@pytest.mark.parametrize("name", ["persistence", "rate_x"])
def test_a_value_just_beyond_is_not_rounded_to_the_bound(name):
    with pytest.raises(ValueError) as error:
        MAKE[name](**{name: 1 + 1e-6})
    assert not str(error.value).endswith("got 1.")


NOT_A_NUMBER = """
from camojab import Display

for value in ("sixty", None, 1j, [[60.0], [60.0, 90.0]]):
    try:
        Display(ppd=60.0, refresh_rate=value, luminance=100.0)
    except (TypeError, ValueError) as error:
        print(error)
    else:
        print("no error")
"""


def test_what_is_not_a_number_is_an_error_that_names_the_argument():
    # In a process without the types being checked, as users run it.
    run = subprocess.run(
        [sys.executable, "-c", NOT_A_NUMBER], capture_output=True, text=True
    )
    lines = run.stdout.splitlines()
    assert len(lines) == 4, run.stderr
    assert all(line.startswith("`refresh_rate` must be ") for line in lines), lines


# ---- flags


@pytest.mark.parametrize("name", ["vrs", "eye_blur", "judder"])
def test_flags(name):
    for value, expected in ((True, True), (0, False), (1.0, True), (np.int8(0), False)):
        flag = getattr(Components(**{name: value}), name)
        assert flag.dtype == bool and flag == expected
    flags = getattr(Components(**{name: np.array([[0, 1]])}), name)
    np.testing.assert_array_equal(flags, [[False, True]])
    for value, shown in ((2, "2"), (-1, "-1"), (0.5, "0.5"), (np.nan, "nan")):
        with pytest.raises(ValueError) as error:
            Components(**{name: value})
        assert str(error.value) == f"`{name}` must be 0 or 1, got {shown}."


def test_one_bad_flag_of_many_is_shown():
    with pytest.raises(ValueError) as error:
        Components(judder=np.array([[0, 1], [2, 1]]))
    assert str(error.value) == "`judder` must be 0 or 1, got 2."


def test_flags_inside_jit_are_boolean():
    make = eqx.filter_jit(lambda flag: Components(vrs=flag))
    assert make(jnp.asarray(False)).vrs == False  # noqa: E712
    with pytest.raises(ValueError, match="^`vrs` must be boolean, got int"):
        make(jnp.asarray(1))


def test_constant_flags_inside_jit_may_be_numbers():
    make = eqx.filter_jit(lambda x: Components(vrs=1, judder=0))
    components = make(jnp.zeros(()))
    assert components.vrs and not components.judder


# ---- values


def test_fields_are_floats_of_the_default_precision():
    default = jnp.zeros(()).dtype
    display = Display(ppd=60, refresh_rate=np.int64(60), luminance=100.0)
    assert {x.dtype for x in jax.tree.leaves(display)} == {default}
    assert not any(x.weak_type for x in jax.tree.leaves(display))
    assert display.persistence == 1


def test_shapes_are_kept():
    display = Display(ppd=np.ones((3, 1)), refresh_rate=60, luminance=np.ones(4))
    assert (display.ppd.shape, display.luminance.shape) == ((3, 1), (4,))


def test_defaults_are_full_rate_and_everything():
    shading, components = Shading(), Components()
    assert (shading.rate_x, shading.rate_y, shading.mip_level) == (1, 1, 0)
    assert components.vrs and components.eye_blur and components.judder


def test_report_is_one_line_with_units():
    display = Display(ppd=60, refresh_rate=np.array([50, 144]), luminance=1e-3)
    assert display.report() == (
        "ppd=60 [px/deg], refresh_rate=50..144 [Hz], luminance=0.001 [cd/m^2], "
        "persistence=1 [1]"
    )
    assert Viewing(12.5).report() == "velocity=12.5 [deg/s]"
    assert (
        Shading(rate_x=0.5).report() == "rate_x=0.5 [1], rate_y=1 [1], mip_level=0 [1]"
    )


# ---- geometry

PANEL = {"refresh_rate": 60.0, "luminance": 100.0}


def test_geometry():
    # A panel of 3000 x 4000 pixels and 5 m: pixels of 1 mm, seen from 1 m.
    display = Display.from_geometry(
        resolution_px=(4000, 3000), diagonal_m=5.0, distance_m=1.0, **PANEL
    )
    degrees_per_pixel = 2 * np.rad2deg(np.arctan(0.0005))
    np.testing.assert_allclose(display.ppd, 1 / degrees_per_pixel, rtol=1e-6)
    assert display.persistence == 1 and display.luminance == 100


@pytest.mark.parametrize(
    "changes, named",
    [
        ({"diagonal_m": 0.0}, "`diagonal_m` must be finite and > 0 m, got 0."),
        ({"distance_m": -1.0}, "`distance_m` must be finite and > 0 m, got -1."),
        ({"distance_m": np.nan}, "`distance_m` must be finite and > 0 m, got nan."),
    ],
)
def test_geometry_errors(changes, named):
    geometry = {"resolution_px": (1920, 1080), "diagonal_m": 0.6, "distance_m": 0.7}
    with pytest.raises(ValueError) as error:
        Display.from_geometry(**geometry | changes, **PANEL)
    assert str(error.value) == named


@pytest.mark.parametrize(
    "changes",
    [
        {"resolution_px": (0, 0)},
        {"resolution_px": (-1920, 1080)},
        {"resolution_px": (1920, 0)},
        {"diagonal_m": np.inf},
        {"distance_m": np.inf},
    ],
)
def test_geometry_that_no_panel_has(changes):
    geometry = {"resolution_px": (1920, 1080), "diagonal_m": 0.6, "distance_m": 0.7}
    (name,) = changes
    with pytest.raises(ValueError, match=f"^`{name}` must be .*, got "):
        Display.from_geometry(**geometry | changes, **PANEL)
