"""What may be fitted, and how a vector of real numbers stands for it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from camojab import Parameters
from camojab._parameters import UNITS
from camojab.fit._constants import constants


X64 = jax.config.jax_enable_x64
# exp and log in single precision: |log| up to 7, of 1e-7 each.
RTOL = 1e-12 if X64 else 1e-5
SETS = ("one", "two", "three")
FREE = (*UNITS, "scales", "lapse")
NAMES = (*UNITS, "scale:two", "scale:three", "lapse")
START = Parameters(ws=-3.0, wt=-2.0, beta=0.4)

magnitude = st.floats(1e-3, 1e3, allow_subnormal=False)


def values_of(found):
    return dict(zip(found.free, np.asarray(found.values(), float), strict=True))


def test_names_and_start():
    found = constants(FREE, SETS, START)
    assert found.free == NAMES
    assert found.units() == {**UNITS, **dict.fromkeys(NAMES[len(UNITS) :], "1")}
    start = values_of(found)
    for name in UNITS:
        np.testing.assert_allclose(start[name], getattr(START, name), rtol=1e-7)
    assert start["scale:two"] == start["scale:three"] == 1
    np.testing.assert_allclose(start["lapse"], 0.02, rtol=1e-6)
    # Held, nobody guesses.
    assert constants(["beta"], SETS, START).lapse == 0
    model = [n for n in UNITS if n not in ("ws", "wt")]
    assert list(found.model()) == model


def test_the_first_scale_may_be_named():
    found = constants(["scale:one", "scales"], SETS, START)
    assert found.free == ("scale:one", "scale:two", "scale:three")


@settings(deadline=None, max_examples=30)
@given(st.lists(magnitude, min_size=14, max_size=14), st.floats(1e-3, 0.9))
def test_values_come_back_from_the_space_of_the_search(sizes, lapse):
    sign = [-1.0, -1.0] + [1.0] * 12
    given = np.array([s * x for s, x in zip(sign, sizes, strict=True)] + [lapse])
    chosen = constants(FREE, SETS, START)
    odds = np.log(np.append(sizes, lapse / (1 - lapse)))
    found = chosen.at(jnp.asarray(odds, float))
    np.testing.assert_allclose(found.values(), given, rtol=RTOL)
    np.testing.assert_allclose(found.point(), odds, rtol=RTOL, atol=RTOL)
    # What is not free stays as it is.
    assert found.scale[0] == 1 and found.free == chosen.free


def test_values_land_where_their_names_say():
    chosen = constants(["lapse", "wt", "scale:three", "cb"], SETS, START)
    found = chosen.at(jnp.log(jnp.array([1.0, 5.0, 7.0, 0.3])))
    np.testing.assert_allclose(found.lapse, 0.5, rtol=RTOL)
    np.testing.assert_allclose(found.parameters.wt, -5.0, rtol=RTOL)
    np.testing.assert_allclose(found.parameters.cb, 0.3, rtol=RTOL)
    np.testing.assert_allclose(found.scale, [1.0, 1.0, 7.0], rtol=RTOL)
    assert found.parameters.ws == START.ws and found.parameters.ca == START.ca


def test_slope_is_the_derivative_of_the_values():
    chosen = constants(FREE, SETS, START)
    point = jnp.asarray(np.random.default_rng(0).normal(size=len(NAMES)), float)
    jacobian = jax.jacfwd(lambda x: chosen.at(x).values())(point)
    np.testing.assert_allclose(
        jacobian, np.diag(np.asarray(chosen.at(point).slope())), rtol=10 * RTOL
    )


def test_freed_changes_nothing_but_what_is_sought():
    chosen = constants(FREE, SETS, START)
    found = chosen.freed(["beta"])
    assert found.free == ("beta",) and chosen.free == NAMES
    assert found.lapse == chosen.lapse and found.parameters is chosen.parameters


@pytest.mark.parametrize(
    "free, message",
    [
        (["gamma"], r"`free` must be of ws, wt, .*scale:three, got 'gamma'\."),
        (["scale:four"], r"`free` must be of ws, .*, got 'scale:four'\."),
        (["ws", "ws"], r"must have each constant once, got 'ws' twice\."),
        (["scales", "scale:two"], r"once, got 'scale:two' twice\."),
        ([], r"`free` must name at least one constant, got none\."),
    ],
)
def test_wrong_names(free, message):
    with pytest.raises(ValueError, match=message):
        constants(free, SETS, START)


def test_no_scales_but_the_first():
    with pytest.raises(ValueError, match="at least one constant, got none"):
        constants(["scales"], SETS[:1], START)


@pytest.mark.parametrize(
    "name, value, rule",
    [
        ("ws", 1.5, "negative"),
        ("wt", 0.0, "negative"),
        ("ca", 0.0, "> 0"),
        ("cb", 0.0, "> 0"),
    ],
)
def test_a_start_from_which_a_constant_cannot_move(name, value, rule):
    start = Parameters(**{"ws": -1.0, "wt": -1.0, "beta": 0.4, name: value})
    message = rf"`start\.{name}` must be {rule} to be fitted, got {value:g}\."
    with pytest.raises(ValueError, match=message):
        constants(["beta", name], SETS, start)
    # Held it may have any value.
    constants(["beta"], SETS, start)


def test_scales_start_where_they_are_told():
    found = constants(["beta"], SETS, START, {SETS[1]: 2.5})
    assert found.scale.tolist() == [1.0, 2.5, *[1.0] * (len(SETS) - 2)]
    with pytest.raises(ValueError, match="`scales` must be of .*, got 'nobody'"):
        constants(["beta"], SETS, START, {"nobody": 2.0})
    with pytest.raises(ValueError, match="`scales` must be finite and > 0, got 0"):
        constants(["beta"], SETS, START, {SETS[0]: 0.0})
