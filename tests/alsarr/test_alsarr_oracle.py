from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr._frame import Frame, frame_from_jindal2021
from alsarr._rates import RATES
from alsarr.oracle import AbstractQualityOracle, TableOracle
from alsarr.solve import greedy_jindal2021
from alsarr.tables import (
    Certificate,
    Conditions,
    Domain,
    Eq31,
    Eq31LogTravel,
    QualityTables,
    Scene,
    TablesJindal2021,
    TensorPolynomial,
)
from alsarr.tables._tables import index_entries
from camojab.datasets import (
    jindal2021_frame,
    jindal2021_material_tables,
)


GOLDEN = Path(__file__).parents[1] / "golden" / "knapsack_scifi.npz"


@pytest.fixture(scope="module")
def scifi(module_data):
    """The authors' frame and tables, at their display and 50 cd/m^2."""
    module_data("jindal2021/ALSaRR/sample_data/motion_n.exr")
    stored, materials = jindal2021_frame(), jindal2021_material_tables()
    frame = frame_from_jindal2021(
        motion_x=stored.motion_x,
        motion_y=stored.motion_y,
        material=stored.material,
        mip_level=stored.mip_level,
        luminance=50,
    )
    tables = TablesJindal2021(materials.coefficients, materials.names)
    return frame, TableOracle(tables)


def test_qualities_of_the_authors_frame(scifi):
    """Golden: the same tables in GNU Octave 7.3, 2026-11-22, tiles row by row."""
    frame, oracle = scifi
    quality = oracle.quality(frame, 60)
    with np.load(GOLDEN) as stored:
        expected = stored["quality_jnd"]
    # In single precision the terms of the polynomials, up to 0.3 JND each, cancel.
    rtol = 1e-12 if jax.config.read("jax_enable_x64") else 2e-6
    np.testing.assert_allclose(quality, expected, rtol=rtol)


def test_map_of_the_authors_frame(scifi):
    frame, oracle = scifi
    found = greedy_jindal2021(oracle.quality(frame, 60), RATES.relative_cost, 32160)
    with np.load(GOLDEN) as stored:
        expected = greedy_jindal2021(stored["quality_jnd"], stored["cost"], 32160)
    # Rounding in single precision may order nearly equal ratios differently.
    allowed = 0 if jax.config.read("jax_enable_x64") else 4
    assert np.sum(found.rate != expected.rate) <= allowed
    np.testing.assert_allclose(found.quality, expected.quality, rtol=1e-6)
    assert oracle.count_outside(frame, 60) == 0
    assert oracle.count_outside(frame, 144) == 67 * 120


def small():
    frame = Frame(
        texture=np.array([[0, 1, 1], [1, 0, 0]]),
        mip_level=np.array([[0.0, 1, 2], [3, 4, 5]]),
        velocity_x=np.array([[0.0, 1, 2], [3, 4, 60]]),
        velocity_y=np.array([[5.0, 4, 3], [2, 1, 0]]),
        luminance=np.array([[1.0, 5, 25], [125, 50, 10]]),
    )
    coefficients = np.random.default_rng(0).normal(size=(2, 12, 2, 10)) * 0.01
    return frame, TableOracle(TablesJindal2021(coefficients, ("a", "b")))


def test_tiles_are_numbered_row_by_row():
    frame, oracle = small()
    quality = oracle.quality(frame, 60)
    assert quality.shape == (6, 7)
    for row in range(2):
        for column in range(3):
            tile = jax.tree.map(
                lambda x, i=row, j=column: x[i : i + 1, j : j + 1], frame
            )
            alone = oracle.quality(tile, 60)
            np.testing.assert_array_equal(quality[3 * row + column], alone[0])
    assert oracle.count_outside(frame, 60) == 1


def distilled(basis, seed=0):
    """Tables of the first texture at two levels and of the last at one."""
    owners = [(0, (0.0,)), (0, (2.0,)), (2, (0.0, 2.0))]
    entry, occurs = index_entries(3, (0.0, 2.0), owners)
    shape = (3, 7, 2)
    coefficients = np.random.default_rng(seed).normal(
        size=(*shape, basis.num_coefficients)
    )
    zero, errors = jnp.zeros(1), np.zeros(shape)
    return QualityTables(
        coefficients=coefficients * 0.01,
        entry=entry,
        occurs=occurs,
        constant=np.zeros(3, bool),
        mip_levels=(0.0, 2.0),
        domain=Domain(velocity=(0.0, 30.0 + seed)),
        certificate=Certificate(
            largest=errors,
            percentile_99=errors,
            median=errors,
            overall=np.zeros(3),
            sample=Conditions(zero, zero, zero),
        ),
        basis=basis,
        texture_names=("a", "b", "c"),
        model="a model",
    )


@pytest.mark.parametrize(
    "basis",
    [Eq31(), Eq31LogTravel(), TensorPolynomial((2, 1, 2), 0.01)],
    ids=lambda basis: basis.name,
)
def test_one_compilation_serves_every_frame_and_distilled_table(basis):
    """Also tables with other numbers and another domain, if of the same shape."""
    frame, _ = small()
    frame = eqx.tree_at(lambda f: f.texture, frame, 2 * frame.texture)
    traced = eqx.debug.assert_max_traces(TableOracle.quality, max_traces=1)
    compiled = eqx.filter_jit(traced)
    for seed in (0, 1):
        oracle = TableOracle(distilled(basis, seed))
        for rate, scale in ((30.0, 1.0), (60.0, 0.5)):
            slower = eqx.tree_at(
                lambda f: f.velocity_x, frame, frame.velocity_x * scale
            )
            got = compiled(oracle, slower, jnp.asarray(rate))
            assert got.shape == (6, 7) and np.isfinite(got).all()
            expected = oracle.quality(slower, rate)
            np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-6)
    absent = eqx.tree_at(lambda f: f.texture, frame, frame.texture * 0 + 1)
    assert np.isfinite(compiled(oracle, absent, jnp.asarray(60.0))).all()


def test_a_texture_that_does_not_occur_is_an_error_on_demand():
    frame, _ = small()
    frame = eqx.tree_at(lambda f: f.texture, frame, 2 * frame.texture)
    oracle = TableOracle(distilled(Eq31()), missing="error")
    every = TableOracle(oracle.tables).quality(frame, 60)
    np.testing.assert_array_equal(oracle.quality(frame, 60), every)
    for texture in (1, 3):
        wrong = eqx.tree_at(
            lambda f: f.texture, frame, frame.texture.at[1, 2].set(texture)
        )
        rule = f"`frame.texture` must be a texture of the tables, .*, got {texture}"
        with pytest.raises(ValueError, match=rule):
            oracle.quality(wrong, 60)
        # Three are outside as it is, and the last tile is one of them.
        assert oracle.count_outside(wrong, 60) == 3
        wrong = eqx.tree_at(
            lambda f: f.texture, frame, frame.texture.at[0, 0].set(texture)
        )
        assert oracle.count_outside(wrong, 60) == 4


def mean_condition(frame):
    buffers = (frame.mip_level, frame.velocity_x, frame.velocity_y, frame.luminance)
    return [np.mean(np.asarray(x)) for x in buffers]


def gain_of(tables, texture, frame, refresh_rate):
    """From 4x4 to 1x1 in the frame's mean condition."""
    number = lambda x: jnp.asarray([x], float)
    at = [number(x) for x in mean_condition(frame)]
    quality = tables.quality(jnp.asarray([texture]), *at, number(refresh_rate)[0])
    return float(quality[0, -1] - quality[0, 0])


@pytest.mark.parametrize("refresh_rate", [40.0, 110.0])
@pytest.mark.parametrize("held", [3, 4])
def test_a_missing_texture_is_judged_as_the_median_one(held, refresh_rate):
    frame, _ = small()
    coefficients = np.random.default_rng(held).normal(size=(held, 12, 2, 10)) * 0.01
    oracle = TableOracle(TablesJindal2021(coefficients, tuple("abcd"[:held])))
    texture = np.array([[held, 1, 9], [held + 1, 0, 1]])
    frame = eqx.tree_at(lambda f: f.texture, frame, jnp.asarray(texture, jnp.int32))
    gains = [gain_of(oracle.tables, t, frame, refresh_rate) for t in range(held)]
    # The middle of three, the lower middle of four.
    stand_in = int(np.argsort(gains)[1])
    got = oracle.quality(frame, refresh_rate)
    known = np.where(texture < held, texture, stand_in)
    as_known = eqx.tree_at(lambda f: f.texture, frame, jnp.asarray(known, jnp.int32))
    np.testing.assert_array_equal(got, oracle.quality(as_known, refresh_rate))
    # The last but one tile is too fast, and three have no table.
    assert oracle.count_outside(as_known, refresh_rate) == 1
    assert oracle.count_outside(frame, refresh_rate) == 4
    # Another stand-in would have been told apart.
    assert len({round(gain, 6) for gain in gains}) == held
    with pytest.raises(ValueError, match=f"which know {held}, got {held}"):
        TableOracle(oracle.tables, missing="error").quality(frame, refresh_rate)


def test_the_stand_in_is_one_that_occurs():
    """Of "a" and "c", since "b" has no table; the one that gains less."""
    frame, _ = small()
    oracle = TableOracle(distilled(Eq31()))
    frame = eqx.tree_at(lambda f: f.texture, frame, 2 * frame.texture)
    gains = {t: gain_of(oracle.tables, t, frame, 60.0) for t in (0, 2)}
    stand_in = min(gains, key=gains.__getitem__)
    for missing in (1, 3):
        some = frame.texture.at[0, 1].set(missing)
        got = oracle.quality(eqx.tree_at(lambda f: f.texture, frame, some), 60)
        known = frame.texture.at[0, 1].set(stand_in)
        expected = oracle.quality(eqx.tree_at(lambda f: f.texture, frame, known), 60)
        np.testing.assert_array_equal(got, expected)


def test_the_nearest_mip_level_is_taken_and_counted():
    """Tables have levels 0 and 2, and 3 rounds to neither; half way is the finer."""
    frame, _ = small()
    frame = eqx.tree_at(lambda f: f.texture, frame, 0 * frame.texture)
    calm = eqx.tree_at(lambda f: f.velocity_x, frame, 0 * frame.velocity_x)
    oracle = TableOracle(distilled(Eq31()))
    at = lambda level: eqx.tree_at(
        lambda f: f.mip_level, calm, jnp.asarray(level, float).reshape(2, 3)
    )
    got = oracle.quality(at([0, 1, 1.25, 2.5, 2.75, 9]), 60)
    np.testing.assert_array_equal(got, oracle.quality(at([0, 0, 2, 2, 2, 2]), 60))
    assert np.any(got[0] != oracle.quality(at([2] * 6), 60)[0])
    # 2.5 still rounds to 2, the two beyond it do not.
    assert oracle.count_outside(at([0, 1, 1.25, 2.5, 2.75, 9]), 60) == 2
    assert oracle.count_outside(at([0, 0, 2, 2, 2, 2]), 60) == 0


def test_tiles_outside_of_distilled_tables_are_counted():
    """60 deg/s is too fast, levels 3 to 5 are too coarse, and 1 rounds to 0."""
    frame, _ = small()
    frame = eqx.tree_at(lambda f: f.texture, frame, 2 * frame.texture)
    oracle = TableOracle(distilled(Eq31()))
    assert oracle.count_outside(frame, 60) == 3
    assert oracle.count_outside(frame, 144) == 6
    assert oracle.count_outside(jax.tree.map(lambda x: x[:1], frame), 60) == 0


def test_no_tile_of_a_scenes_own_frames_is_outside_of_it():
    """Between the levels, at the ends of every range, in single precision or not."""
    rng = np.random.default_rng(0)
    frames = [
        Frame(
            texture=rng.integers(0, 3, (9, 8)),
            mip_level=rng.uniform(0.3, 4.7, (9, 8)),
            velocity_x=rng.uniform(0.1, 30, (9, 8)),
            velocity_y=rng.uniform(0.1, 40, (9, 8)),
            luminance=10 ** rng.uniform(-2, 3, (9, 8)),
        )
        for _ in range(3)
    ]
    scene = Scene.of_frames(frames, num_textures=3, refresh_rate=(59.94, 119.88))
    owners = [(texture, (level,)) for texture, level in scene.pairs]
    entry, occurs = index_entries(3, scene.mip_levels, owners)
    shape, zero = (len(owners), 7, 1), jnp.zeros(1)
    tables = QualityTables(
        coefficients=np.zeros((*shape, 10)),
        entry=entry,
        occurs=occurs,
        constant=np.zeros(len(owners), bool),
        mip_levels=scene.mip_levels,
        domain=scene.domain,
        certificate=Certificate(
            largest=np.zeros(shape),
            percentile_99=np.zeros(shape),
            median=np.zeros(shape),
            overall=np.zeros(3),
            sample=Conditions(zero, zero, zero),
        ),
        basis=Eq31(),
        texture_names=("a", "b", "c"),
        model="a model",
    )
    oracle = TableOracle(tables)
    for frame in frames:
        for rate in (59.94, 90.0, 119.88):
            assert oracle.count_outside(frame, rate) == 0
        assert oracle.count_outside(frame, 120.5) == 72


def test_one_compilation_serves_every_frame_and_table():
    frame, oracle = small()
    traced = eqx.debug.assert_max_traces(TableOracle.quality, max_traces=1)
    compiled = eqx.filter_jit(traced)
    for rate in (30.0, 60.0):
        for each in (frame, jax.tree.map(lambda x: x // 2, frame)):
            got = compiled(oracle, each, jnp.asarray(rate))
            expected = oracle.quality(each, rate)
            np.testing.assert_allclose(got, expected, rtol=1e-5)
    strict = TableOracle(oracle.tables, missing="error")
    unknown = eqx.tree_at(lambda f: f.texture, frame, frame.texture + 1)
    with pytest.raises(RuntimeError, match="`frame.texture` must be a texture of"):
        eqx.filter_jit(TableOracle.quality)(strict, unknown, jnp.asarray(60.0))


def test_what_cannot_be_judged_is_named():
    frame, oracle = small()
    unknown = eqx.tree_at(lambda f: f.texture, frame, frame.texture + 1)
    with pytest.raises(ValueError, match="of the tables, which know 2, got 2"):
        TableOracle(oracle.tables, missing="error").quality(unknown, 60)
    with pytest.raises(
        ValueError, match="`refresh_rate` must be > 0 Hz and finite, got 0"
    ):
        oracle.quality(frame, 0)


def test_an_oracle_must_tell_qualities():
    with pytest.raises(TypeError, match="abstract"):
        AbstractQualityOracle()  # pyright: ignore[reportAbstractUsage]
