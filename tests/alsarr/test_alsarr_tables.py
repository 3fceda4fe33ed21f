import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr._rates import RATES
from alsarr.tables import (
    Domain,
    evaluate_eq31,
    fit_tables,
    load_tables,
    QualityTables,
    save_tables,
    TablesJindal2021,
)


DOMAIN = {
    "velocity": (0.0, 50.0),
    "refresh_rate": (30.0, 120.0),
    "log10_luminance": (-1.0, np.log10(300.0)),
}


def tables(coefficients=None, **changes):
    """Two textures at the levels 0, 1 and 3."""
    if coefficients is None:
        coefficients = np.random.default_rng(0).normal(size=(2, 3, 7, 2, 10))
        coefficients = coefficients * [1, 0.1, 0.01, 1e-3, 1e-3, 1e-4, 0.01, 0.1, 1, 1]
    values = {
        "coefficients": coefficients,
        "mip_levels": (0.0, 1.0, 3.0),
        "domain": Domain(**DOMAIN),
        "largest_error": 0.25,
        "median_error": 0.015625,
        "texture_names": ("brick", "grass"),
        "model": "camojab 0.1.0, a display",
    }
    return QualityTables(**(values | changes))


CONDITIONS = {
    "mip_level": [0.0, 1.0, 0.4, 2.0, 2.1, 9.0],
    "velocity_x": [0.0, 3.0, 50.0, 80.0, 7.0, 7.0],
    "velocity_y": [1.0, 0.0, 49.0, 2.0, 90.0, 7.0],
    "luminance": [0.1, 50.0, 300.0, 300.0, 0.0, 1e4],
}
TEXTURE = np.array([0, 1, 1, 0, 0, 1])
# The nearest level of (0, 1, 3), the finer of two, as an index.
LEVEL = [0, 1, 0, 1, 2, 2]


def conditions():
    dtype = jnp.result_type(float)
    return {name: jnp.asarray(x, dtype) for name, x in CONDITIONS.items()}


def hertz(f):
    return jnp.asarray(f, jnp.result_type(float))


def eq31(w, v, f, level):
    motion = w[0] + w[1] * v + w[2] * f + w[3] * v**2 + w[4] * v * f + w[5] * f**2
    return motion * (w[6] * level**3 + w[7] * level**2 + w[8] * level + w[9])


@pytest.mark.parametrize("refresh_rate", [10.0, 60.0, 240.0])
def test_quality_is_the_mean_of_both_directions_inside_the_domain(refresh_rate):
    table = tables()
    got = table.quality(
        jnp.asarray(TEXTURE), refresh_rate=hertz(refresh_rate), **conditions()
    )
    w = np.asarray(table.coefficients, float)
    f = np.clip(refresh_rate, 30, 120)
    expected = np.empty((6, 7))
    for i in range(6):
        light = np.log10(np.clip(CONDITIONS["luminance"][i], 0.1, 300))
        for k in range(7):
            x, y = w[TEXTURE[i], LEVEL[i], k]
            vx, vy = (min(CONDITIONS[f"velocity_{a}"][i], 50.0) for a in "xy")
            expected[i, k] = (eq31(x, vx, f, light) + eq31(y, vy, f, light)) / 2
    exact = jax.config.read("jax_enable_x64")
    tolerance = 1e-11 if exact else 2e-5
    np.testing.assert_allclose(got, expected, rtol=tolerance, atol=tolerance)


def test_conditions_outside_are_told_apart():
    table = tables()
    outside = table.outside(refresh_rate=hertz(60), **conditions())
    # Too fast in x, too fast in y (and too dark), too bright (and too coarse a level);
    # the ends of the domain are inside.
    np.testing.assert_array_equal(outside, [False, False, False, True, True, True])
    slow = table.outside(refresh_rate=hertz(29), **conditions())
    np.testing.assert_array_equal(slow, True)
    coarse = conditions() | {"mip_level": jnp.full(6, 3.5)}
    assert table.outside(refresh_rate=hertz(60), **coarse).all()


def test_gradients_are_finite_in_the_dark_and_at_the_ends():
    table = tables()

    def total(velocity_x, luminance, refresh_rate):
        values = conditions() | {"velocity_x": velocity_x, "luminance": luminance}
        quality = table.quality(
            jnp.asarray(TEXTURE), refresh_rate=refresh_rate, **values
        )
        return jnp.sum(quality)

    given = conditions()
    gradients = jax.grad(total, argnums=(0, 1, 2))(
        given["velocity_x"], given["luminance"], hertz(60)
    )
    assert all(np.isfinite(g).all() for g in gradients)
    assert np.any(gradients[0] != 0) and gradients[2] != 0


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"texture_names": ("brick",)}, r"`coefficients` must have shape \(1, 3, 7, 2"),
        (
            {"mip_levels": (0.0, 1.0)},
            r"must have shape \(2, 2, 7, 2, 10\) .*got \(2, 3",
        ),
        ({"mip_levels": (0.0, 3.0, 1.0)}, "`mip_levels` must be one or more, rising"),
        ({"mip_levels": (0.0, 1.0, 1.0)}, "`mip_levels` must be one or more, rising"),
    ],
)
def test_tables_that_do_not_fit_together_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        tables(**changes)


def samples():
    axes = np.linspace(0, 50, 4), np.linspace(30, 120, 4), np.linspace(-1, 2.5, 4)
    return [jnp.asarray(x.ravel()) for x in np.meshgrid(*axes, indexing="ij")]


def test_fitted_tables_reproduce_what_they_were_fitted_to():
    v, f, light = samples()
    truth = np.array(tables().coefficients)
    truth[:, :, 0] = 0
    quality = evaluate_eq31(
        jnp.asarray(truth)[..., None, :], *(x[(None,) * 4] for x in (v, f, light))
    )
    ripple = 0.125 * np.sin(v * f) * (np.arange(7) > 0)[:, None, None]
    sampled = jnp.asarray(np.asarray(quality) + ripple)
    fitted = fit_tables(
        v,
        f,
        light,
        sampled,
        mip_levels=(0.0, 1.0, 3.0),
        texture_names=("brick", "grass"),
        model="drawn",
    )
    np.testing.assert_array_equal(fitted.coefficients[:, :, 0], 0)
    np.testing.assert_array_equal(fitted.domain.velocity, [0, 50])
    np.testing.assert_array_equal(fitted.domain.refresh_rate, [30, 120])
    np.testing.assert_array_equal(fitted.domain.log10_luminance, [-1, 2.5])
    again = evaluate_eq31(
        fitted.coefficients[..., None, :], *(x[(None,) * 4] for x in (v, f, light))
    )
    error = np.abs(again - sampled)[:, :, 1:]
    np.testing.assert_allclose(fitted.largest_error, error.max(), rtol=1e-3)
    np.testing.assert_allclose(fitted.median_error, np.median(error), rtol=1e-3)
    assert 0.05 < fitted.largest_error < 0.3
    assert 0.02 < fitted.median_error < fitted.largest_error


def published(coefficients=None, names=("a", "b")):
    if coefficients is None:
        coefficients = np.random.default_rng(1).normal(size=(2, 12, 2, 10))
        coefficients = coefficients * [1, 0.1, 0.01, 1e-3, 1e-3, 1e-4, 0.01, 0.1, 1, 1]
    return TablesJindal2021(coefficients, names)


def test_published_tables_work_by_axis():
    table = published()
    given = conditions()
    got = table.quality(jnp.asarray(TEXTURE), refresh_rate=hertz(60), **given)
    w = np.asarray(table.coefficients, float)
    for i, level in enumerate([0, 1, 0, 2, 2, 9]):
        light = np.log10(CONDITIONS["luminance"][i] + 0.01)
        half, full = w[TEXTURE[i], level]
        for k, name in enumerate(RATES.names):
            axes = zip(name.split("x"), "xy", strict=True)
            quality = [
                {"4": 0, "2": eq31(half, v, 60, light), "1": eq31(full, v, 60, light)}[
                    side
                ]
                for side, axis in axes
                for v in [CONDITIONS[f"velocity_{axis}"][i]]
            ]
            expected = np.mean(quality) + 0.1
            rtol = 1e-11 if jax.config.read("jax_enable_x64") else 1e-4
            np.testing.assert_allclose(got[i, k], expected, rtol=rtol, atol=rtol)


def test_published_tables_limit_the_mip_level_alone():
    table = published()
    given = conditions()
    beyond = given | {"mip_level": jnp.full_like(given["mip_level"], 14)}
    last = given | {"mip_level": jnp.full_like(given["mip_level"], 11)}
    quality = [
        table.quality(jnp.asarray(TEXTURE), refresh_rate=hertz(60), **values)
        for values in (beyond, last)
    ]
    np.testing.assert_array_equal(*quality)
    outside = table.outside(refresh_rate=hertz(60), **given)
    np.testing.assert_array_equal(outside, [False, False, False, True, True, True])
    assert table.outside(refresh_rate=hertz(60), **beyond).all()


def test_published_tables_must_have_their_shape():
    with pytest.raises(ValueError, match=r"shape \(1, 12, 2, 10\) .*got \(2, 12, 2, 1"):
        published(names=("a",))


def test_file_holds_every_bit_of_single_precision(tmp_path):
    path = tmp_path / "tables.json"
    table = tables()
    save_tables(path, table)
    read = load_tables(path)
    np.testing.assert_array_equal(
        np.asarray(read.coefficients, np.float32),
        np.asarray(table.coefficients, np.float32),
    )
    save_tables(tmp_path / "again.json", read)
    assert eqx.tree_equal(load_tables(tmp_path / "again.json"), read)
    rest = lambda t: eqx.tree_at(lambda t: t.coefficients, t, None)
    assert eqx.tree_equal(rest(read), rest(table))


def test_file_explains_itself_and_is_strict_json(tmp_path):
    path = tmp_path / "tables.json"
    save_tables(path, tables())
    refuse = lambda token: pytest.fail(f"{token} is no JSON")
    document = json.loads(path.read_text(), parse_constant=refuse)
    assert document["schema"] == "alsarr-tables/2"
    assert document["basis"] == "eq31" and document["unit"] == "JND"
    assert document["rates"] == list(RATES.names)
    assert document["textures"] == ["brick", "grass"]
    assert document["mip_levels"] == [0, 1, 3]
    assert document["variables"]["velocity"] == {
        "symbol": "v",
        "unit": "deg/s",
        "domain": [0, 50],
    }
    assert document["largest_error_jnd"] == 0.25
    assert document["median_error_jnd"] == 0.015625
    assert document["model"] == "camojab 0.1.0, a display"
    digits = [
        len(number.strip("-0").replace(".", "").split("e")[0].lstrip("0"))
        for line in path.read_text().splitlines()
        if line.startswith("[[")
        for number in line.replace("[", "").replace("]", "").rstrip(",").split(", ")
    ]
    assert len(digits) == 2 * 3 * 7 * 2 * 10 and max(digits) == 9


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda d: d.update(schema="other/9"), "`schema` must be .*, got 'other/9'"),
        (lambda d: d.update(unit="JOD"), "`unit` must be 'JND', got 'JOD'"),
        (lambda d: d["rates"].reverse(), "`rates` must be "),
        (lambda d: d.pop("model"), "`model` must be there and be a str"),
        (lambda d: d.pop("variables"), "`variables` must be there and be a dict"),
        (lambda d: d["variables"].pop("velocity"), "`velocity` must be there"),
        (
            lambda d: d["variables"]["velocity"].update(domain=[5, 1]),
            r"domain of velocity must rise, got \[5\.0, 1\.0\]",
        ),
        (
            lambda d: d["variables"]["velocity"].update(domain=[5]),
            r"`domain` must have shape \(2,\), got \(1,\)",
        ),
        (lambda d: d["textures"].pop(), r"must have shape \(1, 3, 7, 2, 10\), got"),
        (lambda d: d["coefficients"][0].pop(), "`coefficients` must be numbers of"),
        (
            lambda d: d["coefficients"][1][2][6][1].__setitem__(9, float("nan")),
            "`coefficients` must be finite",
        ),
        (
            lambda d: d.update(median_error_jnd="small"),
            "`median_error_jnd` must be num",
        ),
        (
            lambda d: d["mip_levels"].reverse(),
            "`mip_levels` must be one or more, rising",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path, change, message):
    path = tmp_path / "tables.json"
    save_tables(path, tables())
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(ValueError, match=f"tables.json: .*{message}"):
        load_tables(path)


@pytest.mark.parametrize("text", ["", "{", "\ufeff{}", "[1]"])
def test_what_is_no_json_object_is_refused(tmp_path, text):
    path = tmp_path / "tables.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(
        ValueError, match="tables.json: (is no JSON|must hold one JSON)"
    ):
        load_tables(path)


def test_a_failure_leaves_the_old_file_alone(tmp_path):
    path = tmp_path / "tables.json"
    save_tables(path, tables())
    before = path.read_bytes()
    with pytest.raises(ValueError, match="`tables` must hold numbers that are finite"):
        save_tables(path, tables(coefficients=np.full((2, 3, 7, 2, 10), np.nan)))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["tables.json"]
