"""MARRR: the authors' program, the printed constants, limits, gradients."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from jax.test_util import check_grads

from camojab import Display, Shading, Viewing
from camojab.baselines import Denes2020, quality_denes2020, quality_terms_denes2020


# Computed with predict_quality_difference.m of gfxdisp/motion_quality_20 (model/ at
# 3239c1a, csf_spatiotemp_kelly.m of gfxdisp/ALSaRR at e7ecdda) in GNU Octave 7.3:
# quality of each row minus that of 100 Hz at full resolution, 2560 px over 30 deg.
GOLDEN = Path(__file__).parent / "golden" / "denes2020.csv"
ANCHOR = {"ppd": 2560 / 30, "refresh_rate": 100.0}

X64 = jax.config.jax_enable_x64
# Sums of nine terms that reach 20 JND, which single precision rounds at 2e-6.
ATOL = 1e-12 if X64 else 3e-5


def display(ppd=60.0, refresh_rate=60.0, persistence=1.0, luminance=100.0):
    return Display(
        ppd=ppd,
        refresh_rate=refresh_rate,
        persistence=persistence,
        luminance=luminance,
    )


@pytest.mark.parametrize("predictable", [True, False])
def test_golden(predictable):
    rows = np.genfromtxt(GOLDEN, delimiter=",", names=True)
    rows = rows[rows["predictable"] == predictable]
    assert len(rows) == 160
    constants = Denes2020.released(predictable=predictable)
    viewing = Viewing(rows["velocity_deg_s"])
    shown = quality_denes2020(
        display(rows["ppd"], rows["refresh_rate_hz"], rows["persistence"]),
        viewing,
        Shading(rate_x=rows["rate"], rate_y=rows["rate"]),
        constants,
    )
    anchor = display(**ANCHOR, persistence=rows["persistence"])
    difference = shown - quality_denes2020(anchor, viewing, None, constants)
    np.testing.assert_allclose(difference, rows["quality_jnd"], rtol=0, atol=ATOL)


def test_the_authors_example():
    # demo.m of the same program: 165 Hz at 3/4 resolution against 100 Hz, 5 deg/s.
    fast, slow = display(2560 / 30, 165.0), display(2560 / 30, 100.0)
    reduced = Shading(rate_x=0.75, rate_y=0.75)
    difference = quality_denes2020(fast, Viewing(5), reduced) - quality_denes2020(
        slow, Viewing(5)
    )
    np.testing.assert_allclose(difference, 0.15238115175640285, rtol=0, atol=ATOL)


def test_printed_constants_differ_in_three_things():
    for predictable in (True, False):
        released = Denes2020.released(predictable=predictable)
        printed = Denes2020.printed(predictable=predictable)
        same = {
            name: bool(np.array_equal(value, getattr(printed, name)))
            for name, value in vars(released).items()
        }
        different = {name for name, equal in same.items() if not equal}
        assert different == {"pa", "pb", "frequencies", "judder"}
        assert printed.judder == -released.judder
        np.testing.assert_array_equal(released.frequencies[2:], printed.frequencies)
        assert printed.frequencies[0] == 1 and printed.frequencies[-1] == 64


def test_the_predictable_printed_eye_blur_is_camojabs():
    from camojab import Parameters

    printed, ours = Denes2020.printed(), Parameters.published()
    assert (printed.pa, printed.pb) == (ours.ca, ours.cb)


def test_judder_lowers_quality_as_released_and_raises_it_as_printed():
    moving = display(refresh_rate=jnp.array([50.0, 100.0])), Viewing(25)
    released = quality_terms_denes2020(*moving).judder
    printed = quality_terms_denes2020(*moving, None, Denes2020.printed()).judder
    assert released[0] < released[1] < 0
    np.testing.assert_allclose(printed, -released, rtol=1e-6)


def test_terms_add_up():
    where = display(refresh_rate=72.0), Viewing(20), Shading(rate_x=0.5)
    terms = quality_terms_denes2020(*where)
    total = terms.parallel + terms.orthogonal + terms.judder
    np.testing.assert_array_equal(quality_denes2020(*where), total)
    assert terms.parallel < terms.orthogonal


def test_each_axis_feels_its_own_resolution():
    at = lambda **rate: quality_terms_denes2020(
        display(refresh_rate=1e6), Viewing(0), Shading(**rate), sharp_eye
    )
    # No eye blur and no motion: both axes blur by the resolution alone.
    sharp_eye = Denes2020(
        pa=0, pb=0, frequencies=np.array([4.0]), judder_threshold=200, judder=-1
    )
    half_x, half_y = at(rate_x=0.5), at(rate_y=0.5)
    np.testing.assert_allclose(half_x.parallel, half_y.orthogonal, rtol=1e-6)
    np.testing.assert_allclose(half_x.orthogonal, half_y.parallel, rtol=1e-6)
    # Eq. 9 and 12 at 4 cycles/deg: exp(-4 (w/R)^2), R = 60 against 30 px/deg.
    beta = float(sharp_eye.blur_exponent)
    ratio = np.exp(-4 * beta * (16 / 30**2 - 16 / 60**2))
    got = half_x.parallel / half_y.parallel
    np.testing.assert_allclose(got, ratio, rtol=1e-5)


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.1, 300),
    st.floats(10, 1000),
    st.floats(0.02, 0.9),
    st.floats(0.1, 0.9),
)
def test_less_blur_is_never_worse(velocity, refresh_rate, persistence, rate):
    at = lambda v=velocity, p=persistence, r=rate: quality_terms_denes2020(
        display(refresh_rate=refresh_rate, persistence=p),
        Viewing(v),
        Shading(rate_x=r, rate_y=r),
    )
    here = at()
    assert at(v=0.5 * velocity).parallel >= here.parallel
    assert at(p=0.5 * persistence).parallel >= here.parallel
    assert at(r=0.5 * rate).parallel <= here.parallel
    assert at(r=0.5 * rate).orthogonal < here.orthogonal


def test_luminance_and_mip_level_play_no_part():
    one = quality_denes2020(display(luminance=1.0), Viewing(9), Shading(mip_level=0))
    other = quality_denes2020(
        display(luminance=900.0), Viewing(9), Shading(mip_level=4)
    )
    assert one == other


def test_shapes_broadcast_and_must():
    rates = jnp.asarray(np.array([60.0, 120.0])[:, None])
    q = quality_denes2020(
        display(refresh_rate=rates), Viewing(np.array([0.0, 5.0, 10.0]))
    )
    assert q.shape == (2, 3)
    alone = quality_denes2020(display(refresh_rate=120.0), Viewing(5.0))
    np.testing.assert_allclose(q[1, 1], alone, rtol=1e-6)
    with pytest.raises(ValueError, match="broadcast"):
        quality_denes2020(display(refresh_rate=np.ones(2)), Viewing(np.ones(3)))


@pytest.mark.parametrize("velocity", [0.0, 1e-4, 1.0, 1e3])
@pytest.mark.parametrize("refresh_rate", [1.0, 60.0, 2e3])
@pytest.mark.parametrize("persistence", [1e-6, 1.0])
def test_extremes_are_finite_with_finite_gradients(velocity, refresh_rate, persistence):
    def quality(v, f, p, ppd):
        return quality_denes2020(display(ppd, f, p), Viewing(v))

    at = [jnp.asarray(x, float) for x in (velocity, refresh_rate, persistence, 1e3)]
    value, slopes = jax.value_and_grad(quality, (0, 1, 2, 3))(*at)
    assert np.isfinite(value) and np.isfinite(slopes).all()


@pytest.mark.float64
# Finite differences lose half of the digits, which single precision does not have.
def test_gradients_agree_with_differences():
    at = jnp.array([17.0, 83.0, 0.4, 41.0, 0.6, 0.8])
    released = Denes2020.released()

    def quality(conditions, constants):
        # Relative changes, so that one step suits all.
        v, f, p, ppd, rx, ry = at * conditions
        constants = jax.tree.map(jnp.multiply, released, constants)
        shading = Shading(rate_x=rx, rate_y=ry)
        return quality_denes2020(display(ppd, f, p), Viewing(v), shading, constants)

    ones = jnp.ones(6), jax.tree.map(jnp.ones_like, released)
    check_grads(quality, ones, 1, rtol=1e-6)


def test_one_compilation_serves_all_values():
    @eqx.filter_jit
    @eqx.debug.assert_max_traces(max_traces=1)
    def quality(display, viewing, constants):
        return quality_denes2020(display, viewing, None, constants)

    for rate in (30.0, 60.0, 144.0):
        for predictable in (True, False):
            constants = Denes2020.released(predictable=predictable)
            assert np.isfinite(quality(display(50.0, rate), Viewing(rate), constants))


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"pa": -1.0}, "`pa` must be finite and >= 0 s, got -1."),
        (
            {"frequencies": np.array([1.0, 0.0])},
            "`frequencies` must be finite and > 0 cycles/deg",
        ),
        ({"judder": np.inf}, "`judder` must be finite .JND., got inf"),
        ({"blur_exponent": 0.0}, "`blur_exponent` must be finite and > 0, got 0"),
    ],
)
def test_wrong_constants_are_named(wrong, message):
    right = {
        "pa": 0.0,
        "pb": 0.0,
        "frequencies": np.ones(1),
        "judder_threshold": 1.0,
        "judder": -1.0,
    }
    with pytest.raises(ValueError, match=message):
        Denes2020(**{**right, **wrong})
