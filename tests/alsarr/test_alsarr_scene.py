"""What a scene needs of the tables, and the conditions these are fitted to."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import Frame, procedural_frame
from alsarr.tables import Conditions, Domain, Grid, Scene
from alsarr.tables._domain import clipped, held_out, scaled
from alsarr.tables._scene import left_out


X64 = jax.config.read("jax_enable_x64")


def frame(**changes):
    given = {
        "texture": [[2, 2, 0]],
        "mip_level": [[0.5, 0.6, 3.2]],
        "velocity_x": [[3.0, 8.0, 5.0]],
        "velocity_y": [[2.0, 4.0, 25.0]],
        "luminance": [[10.0, 50.0, 100.0]],
    } | changes
    return Frame(**{k: np.asarray(v) for k, v in given.items()})


def scene(*frames, num_textures=3, refresh_rate=(60.0, 120.0)):
    return Scene.of_frames(frames, num_textures=num_textures, refresh_rate=refresh_rate)


def ends(domain):
    return [np.asarray(x, float).tolist() for x in jax.tree.leaves(domain)]


def test_a_frame_needs_exactly_what_occurs_in_it():
    """0.5 is as near to 0 as to 1, and the finer is taken."""
    found = scene(frame())
    assert found.pairs == ((0, 3.0), (2, 0.0), (2, 1.0))
    assert found.mip_levels == (0.0, 1.0, 3.0) and found.num_textures == 3
    velocity, refresh_rate, light = ends(found.domain)
    # Slowest along x or y, fastest along either.
    assert (velocity, refresh_rate) == ([2.0, 25.0], [60.0, 120.0])
    np.testing.assert_allclose(light, [1, 2], rtol=1e-6)


def test_several_frames_need_what_any_of_them_needs():
    other = frame(
        texture=[[1, 2, 0]],
        mip_level=[[0.0, 1.4, 3.0]],
        velocity_x=[[1.0, 40.0, 1.0]],
        luminance=[[100.0, 1000.0, 100.0]],
    )
    both = scene(frame(), other)
    assert both.pairs == ((0, 3.0), (1, 0.0), (2, 0.0), (2, 1.0))
    velocity, _, light = ends(both.domain)
    assert velocity == [1.0, 40.0]
    np.testing.assert_allclose(light, [1, 3], rtol=1e-6)
    assert scene(other, frame()).pairs == both.pairs


def test_frames_of_other_shapes_go_together():
    small = frame()
    large = procedural_frame(3, rows=4, columns=7, seed=0)
    both = scene(small, large)
    assert set(both.pairs) == set(scene(small).pairs) | set(scene(large).pairs)


def test_black_tiles_count_as_a_thousandth():
    light = ends(scene(frame(luminance=0.0)).domain)[2]
    np.testing.assert_allclose(light, [-3, -3])
    light = ends(scene(frame(luminance=[[0.0, 1e-5, 10.0]])).domain)[2]
    np.testing.assert_allclose(light, [-3, 1], rtol=1e-6)


def test_every_texture_at_every_level():
    found = Scene.every(2, (0, 2.5))
    assert found.pairs == ((0, 0.0), (0, 2.5), (1, 0.0), (1, 2.5))
    assert eqx.tree_equal(found.domain, Domain())
    narrow = Domain(velocity=(1.0, 2.0))
    published = Scene.every(3, domain=narrow)
    assert len(published.pairs) == 36 and published.domain is narrow
    assert published.mip_levels == tuple(float(m) for m in range(12))


def test_what_is_left_out_is_said_in_runs():
    text = left_out(Scene.every(2, (0, 1, 2, 5)), ("brick", "grass"))
    assert text == (
        "8 of 24 pairs of texture and mip level; left out: "
        "brick 3-4+6-11, grass 3-4+6-11"
    )
    assert left_out(Scene.every(1), ("brick",)) == (
        "12 of 12 pairs of texture and mip level; left out: none"
    )
    one = Scene(2, tuple((0, float(m)) for m in range(12)), Domain())
    assert left_out(one, ("a", "b")).endswith("left out: b 0-11")


NARROW = Domain()


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Scene(1, (), NARROW), "`pairs` must be one or more, got none"),
        (
            lambda: Scene(2, ((2, 0.0),), NARROW),
            "`pairs` must have texture indices from 0 to 1, got 2",
        ),
        (lambda: Scene(2, ((-1, 0.0),), NARROW), "from 0 to 1, got -1"),
        (
            lambda: Scene(2, ((0, -1.0),), NARROW),
            "`pairs` must have finite mip levels >= 0, got -1",
        ),
        (lambda: Scene(2, ((0, np.inf),), NARROW), "finite mip levels >= 0, got inf"),
        (lambda: Scene(2, ((0, np.nan),), NARROW), "finite mip levels >= 0, got nan"),
        (
            lambda: Scene(2, ((1, 0.0), (0, 0.0)), NARROW),
            "`pairs` must rise, each once",
        ),
        (lambda: Scene(1, ((0, 0.0), (0, 0.0)), NARROW), "must rise, each once"),
        (lambda: Scene.every(0), "`num_textures` must be >= 1, got 0"),
        (
            lambda: Scene.every(1, ()),
            r"`mip_levels` must be one or more, rising, got \(\)",
        ),
        (lambda: Scene.every(1, (2, 0)), r"rising, got \(2, 0\)"),
        (lambda: Scene.every(1, (0, 0)), r"rising, got \(0, 0\)"),
        (lambda: Scene.every(1, (-1,)), "finite mip levels >= 0, got -1"),
        (lambda: scene(), "`frames` must have at least one frame, got none"),
        (lambda: scene(frame(), num_textures=2), "indices from 0 to 1, got 2"),
        (
            lambda: scene(frame(), refresh_rate=(120.0, 60.0)),
            "`refresh_rate` must be lowest first, then highest",
        ),
        (
            lambda: scene(frame(), refresh_rate=(0.0, 60.0)),
            "`refresh_rate` must be > 0 Hz and finite, got 0",
        ),
        (
            lambda: Domain(velocity=(-1.0, 5.0)),
            "`velocity` must be >= 0 deg/s and finite, got -1",
        ),
        (lambda: Domain(velocity=(0.0, np.inf)), "`velocity` must be .*, got inf"),
        (
            lambda: Domain(log10_luminance=(0.0, np.nan)),
            "`log10_luminance` must be finite, got nan",
        ),
        (
            lambda: Domain(refresh_rate=np.array([30.0, 60.0, 90.0])),
            r"`refresh_rate` must be lowest and highest, got shape \(3,\)",
        ),
        (
            lambda: Grid.over(NARROW, (1, 3, 3)),
            r"`sizes` must be 2 or more of each, got \(1, 3, 3\)",
        ),
    ],
)
def test_what_cannot_be(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_the_default_grid_and_domain_are_the_authors():
    """ALSaRR/fit_polynomials of gfxdisp/ALSaRR at d06b3e0."""
    velocity, refresh_rate, light = (np.asarray(x) for x in Grid().conditions())
    assert velocity.shape == (6 * 7 * 4,)
    assert sorted(set(velocity.tolist())) == [0, 10, 20, 30, 40, 50]
    assert sorted(set(refresh_rate.tolist())) == [30, 45, 60, 75, 90, 105, 120]
    assert sorted(set(light.tolist())) == [-1, 1, 2, 2.5]
    every = zip(velocity.tolist(), refresh_rate.tolist(), light.tolist(), strict=True)
    assert len(set(every)) == 168
    assert light[:4].tolist() == [-1, 1, 2, 2.5] and (velocity[:28] == 0).all()
    assert eqx.tree_equal(Grid().domain, Domain())
    np.testing.assert_allclose(Domain().luminance, [0.1, 10**2.5], rtol=1e-6)


def single(low, high):
    """Two numbers of single precision, the lower one first."""
    return (
        st.tuples(*[st.floats(low, high, width=32, allow_subnormal=False)] * 2)
        .map(sorted)
        .map(tuple)
    )


domains = st.builds(
    Domain,
    velocity=single(0, 1024),
    refresh_rate=single(1, 2048),
    log10_luminance=single(-3, 4),
)


@settings(deadline=None, max_examples=25)
@given(domains)
def test_a_grid_over_a_domain_has_its_ends_and_stays_inside(domain):
    sizes = (5, 4, 3)
    grid = Grid.over(domain, sizes)
    axes = (grid.velocity, grid.refresh_rate, grid.log10_luminance)
    for axis, (low, high), size in zip(axes, ends(domain), sizes, strict=True):
        assert axis[0] == low and axis[-1] == high
        assert list(axis) == sorted(set(axis))
        # Points nearer than rounding become one.
        assert len(axis) == 1 if low == high else 2 <= len(axis) <= size
    assert eqx.tree_equal(grid.domain, domain)
    assert grid.conditions().velocity.size == np.prod([len(axis) for axis in axes])


def test_a_grid_over_a_domain_has_chebyshevs_points():
    domain = Domain(
        velocity=(0.0, 31.5), refresh_rate=(30.0, 120.0), log10_luminance=(-1.0, 3.0)
    )
    grid = Grid.over(domain, (3, 5, 4))
    # ln(0.5 + v) is half way from 0.5 to 32 at 4.
    np.testing.assert_allclose(grid.velocity, [0, 3.5, 31.5], rtol=1e-6)
    share = np.log(np.array(grid.refresh_rate) / 30) / np.log(4)
    np.testing.assert_allclose(
        1 - 2 * share, np.cos(np.pi * np.arange(5) / 4), atol=1e-6
    )
    np.testing.assert_allclose(grid.log10_luminance, [-1, 0, 2, 3], atol=1e-6)
    assert Grid.over(domain).conditions().velocity.size == 17 * 9 * 8


@settings(deadline=None, max_examples=15)
@given(domains)
def test_held_out_conditions_are_inside_and_in_single_precision(domain):
    at = held_out(domain)
    every = np.stack([np.asarray(x, float) for x in at])
    assert every.shape == (3, 1032)
    for values, (low, high) in zip(every, ends(domain), strict=True):
        assert values.min() == low and values.max() == high
        np.testing.assert_array_equal(values, values.astype(np.float32))
    corners = np.stack(np.meshgrid(*ends(domain), indexing="ij"), -1).reshape(-1, 3)
    np.testing.assert_array_equal(every.T[-8:], corners)
    again = held_out(domain)
    assert all((a == b).all() for a, b in zip(at, again, strict=True))


def test_held_out_conditions_fill_the_domain():
    """Each of 4 x 4 x 4 boxes of the scales they are even on holds as many."""
    domain = Domain()
    at = [np.asarray(x, float)[:1024] for x in held_out(domain)]
    at[0] = np.log(0.5 + at[0])
    (_, fast), rates, light = ends(domain)
    axes = zip(at, [(np.log(0.5), np.log(0.5 + fast)), rates, light], strict=True)
    # Rounding to single precision may carry a point over the edge of its box.
    boxes = [
        np.minimum(np.floor(4 * (x - a) / (b - a) + 1e-6), 3).astype(int)
        for x, (a, b) in axes
    ]
    count = np.zeros((4, 4, 4), int)
    np.add.at(count, tuple(boxes), 1)
    assert count.min() >= 15 and count.max() <= 17


def test_held_out_conditions_are_not_those_of_the_grid():
    """But for the corners, which both have."""
    tuples = lambda at: set(zip(*(np.asarray(x).tolist() for x in at), strict=True))
    domain = Domain()
    common = tuples(held_out(domain)) & tuples(Grid.over(domain).conditions())
    assert len(common) == 8


def test_conditions_outside_are_moved_to_the_edge():
    at = Conditions(
        jnp.array([-1.0, 20.0, 90.0]),
        jnp.array([10.0, 60.0, 240.0]),
        jnp.array([-3.0, 1.0, 4.0]),
    )
    got = clipped(at, Domain())
    np.testing.assert_array_equal(got.velocity, [0, 20, 50])
    np.testing.assert_array_equal(got.refresh_rate, [30, 60, 120])
    np.testing.assert_array_equal(got.log10_luminance, [-1, 1, 2.5])


def test_scaling_maps_the_ends_to_one_and_an_axis_of_no_width_to_zero():
    np.testing.assert_allclose(
        scaled(jnp.array([30.0, 75.0, 120.0, 165.0]), jnp.array([30.0, 120.0])),
        [-1, 0, 1, 2],
        atol=1e-6,
    )
    np.testing.assert_array_equal(scaled(jnp.array([60.0]), jnp.array([60.0] * 2)), 0)
    slope = jax.grad(lambda x: scaled(x, jnp.array([60.0, 60.0])))(jnp.array(60.0))
    np.testing.assert_array_equal(slope, 0)
