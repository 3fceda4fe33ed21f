"""What the explorer computes is what the packages compute."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import mean_velocity, RATES
from alsarr.explore import _chain, _curves, _frame_map, _library
from alsarr.explore._conditions import Conditions
from alsarr.oracle import Denes2020Oracle
from alsarr.solve import lagrangian
from camojab import (
    Components,
    datasets,
    Display,
    distortion,
    Parameters,
    quality,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._condition import Condition
from camojab._released import fields


PLACES = (
    Conditions(),
    Conditions(velocity=0.0, refresh_rate=120.0, ppd=30.0),
    Conditions(velocity=45.0, refresh_rate=30.0, persistence=0.05, luminance=2.5),
)


pytestmark = pytest.mark.usefixtures("quick_compilation")


@pytest.fixture(scope="module")
def textures():
    """Two textures with structure at every frequency."""
    noise = np.random.default_rng(3).uniform(size=(2, 512, 512))
    soft = (noise[1] + np.roll(noise[1], 1, axis=1)) / 2
    return {"noise": noise[0], "soft": soft}


@pytest.fixture(scope="module")
def spectra(textures):
    return {name: Spectrum.from_texture(image) for name, image in textures.items()}


@pytest.fixture(scope="module")
def parameters():
    return Parameters.published()


@pytest.fixture(scope="module")
def pooled(spectra, parameters):
    shading = _curves.shading("2x4", 1.0)
    return _curves.pooled_texture(spectra["soft"], shading, parameters)


def display(at):
    return Display(
        ppd=at.ppd,
        refresh_rate=at.refresh_rate,
        luminance=at.luminance,
        persistence=at.persistence,
    )


def test_a_rate_is_its_resolution():
    shading = _curves.shading("2x4", 3.0)
    found = [float(x) for x in (shading.rate_x, shading.rate_y, shading.mip_level)]
    assert found == [0.5, 0.25, 3.0]


@pytest.mark.parametrize("at", PLACES)
def test_curves_are_the_exact_model_nearly(spectra, parameters, pooled, at):
    found = _curves.curves(pooled, at)
    some = slice(None, None, 60)
    v, f = _curves.VELOCITIES[some], _curves.REFRESH_RATES[some]
    same = lambda x, like: np.full(len(like), x)
    velocity = np.concatenate([v, same(at.velocity, f), [at.velocity]])
    refresh_rate = np.concatenate([same(at.refresh_rate, v), f, [at.refresh_rate]])
    exact = distortion(
        spectra["soft"],
        display(at._replace(refresh_rate=refresh_rate)),
        Viewing(velocity),
        _curves.shading("2x4", 1.0),
        parameters,
    )
    ends = [len(v), len(v) + len(f)]
    spatial = np.split(parameters.ws * exact.spatial, ends)
    temporal = np.split(parameters.wt * exact.temporal, ends)
    shown = lambda parts: jax.tree.map(lambda x: x[some], parts)
    pieces = shown(found.by_velocity), shown(found.by_refresh_rate), found.here
    for i, parts in enumerate(pieces):
        # What the pool leaves out, at the most.
        np.testing.assert_allclose(
            parts.spatial, spatial[i].squeeze(), rtol=0, atol=0.005
        )
        np.testing.assert_allclose(
            parts.temporal, temporal[i].squeeze(), rtol=0, atol=0.005
        )
        np.testing.assert_allclose(parts.quality, parts.spatial + parts.temporal)


def test_curves_are_compiled_once(spectra, parameters, pooled, monkeypatch):
    _curves.curves(pooled, PLACES[0])
    other = _curves.shading("1x1", 0.0)
    again = _curves.pooled_texture(spectra["noise"], other, parameters)

    def traced(**_):
        raise AssertionError("traced anew")

    monkeypatch.setattr(_curves, "Display", traced)
    for at in PLACES:
        assert np.all(np.isfinite(_curves.curves(again, at).by_velocity.quality))


def by_column(power):
    """Root mean square over rows and over the sign of the column's frequency."""
    both = np.sum(power, axis=0)
    count = np.full(257, 1024.0)
    count[[0, 256]] = 512
    folded = both[256::-1].copy()
    folded[1:256] += both[257:]
    return np.sqrt(folded / count)[1:]


@pytest.mark.parametrize("at", PLACES)
def test_stages_are_those_of_the_model(spectra, parameters, at):
    spectrum, shading = spectra["soft"], _curves.shading("2x4", 1.0)
    amplitude = np.asarray(spectrum.amplitude, float)
    found = _chain.stages(_chain.chain(spectrum, shading, parameters), at)
    dtype = spectrum.amplitude.dtype
    condition = Condition(
        display(at), Viewing(at.velocity), shading, Components(), parameters
    )
    condition = jax.tree.map(
        lambda x: x if x.dtype == bool else x.astype(dtype), condition
    )
    # Eager, these would be compiled operation by operation.
    model = eqx.filter_jit(fields)(spectrum.amplitude, condition)
    names = ("reference", "perceived", "replica")
    # Single precision sums a quarter of a million squares.
    close = {"rtol": 2e-4 if dtype == jnp.float32 else 1e-5, "atol": 1e-9}
    for name, field in zip(names, model, strict=True):
        power = np.exp(2 * np.asarray(field.log, float))
        np.testing.assert_allclose(getattr(found, name), by_column(power), **close)

    np.testing.assert_allclose(found.texture, by_column(amplitude**2), **close)
    k = np.arange(-256, 256) / 512
    # Two texels wide at level 1, and four times that at a side of four.
    width = 8.0
    low = 1 / (1 + (4 / np.pi * k * width) ** 2)
    mipmapped = amplitude * low[None, :] * low[:, None]
    np.testing.assert_allclose(found.mipmap, by_column(mipmapped**2), **close)
    np.testing.assert_allclose(found.frequency, np.arange(1, 257) * at.ppd / 512)


def test_stages_follow_one_another(spectra, parameters):
    at = Conditions(velocity=20.0)
    shading = _curves.shading("2x2", 0.0)
    s = _chain.stages(_chain.chain(spectra["noise"], shading, parameters), at)
    assert np.all(s.mipmap <= s.texture) and np.all(s.pursuit <= s.hold)
    assert np.all(s.hold <= s.coarse_shading)
    # Coarse shading adds a replica, and leaves nothing beyond half of Nyquist.
    assert np.sum(s.coarse_shading[:120]) > np.sum(s.mipmap[:120])
    assert np.all(s.coarse_shading[128:] == 0) and np.all(s.perceived[128:] == 0)
    step = s.frequency
    hold = 1 / (1 + (4 / np.pi * step * 20 / 60) ** 2)
    kept = slice(0, 128)
    np.testing.assert_allclose(s.hold[kept], (s.coarse_shading * hold)[kept], rtol=1e-4)


def test_a_flat_texture_has_a_spectrum_too(parameters):
    flat = Spectrum.from_texture(np.zeros((512, 512)))
    shading = _curves.shading("4x4", 0.0)
    found = _chain.stages(_chain.chain(flat, shading, parameters), Conditions())
    assert all(np.all(x == 0) for x in found[1:])
    pooled = _curves.pooled_texture(flat, shading, parameters)
    curves = _curves.curves(pooled, Conditions())
    np.testing.assert_allclose(curves.here.quality, 0, atol=1e-6)


@pytest.fixture(scope="module")
def drawn(textures, spectra):
    return _frame_map.drawn_frame(textures, spectra)


@pytest.mark.parametrize("at", PLACES[1:])
def test_the_frame_moves_and_shines_as_asked(drawn, at):
    shown = _frame_map.adapted(drawn.frame, at)
    np.testing.assert_allclose(mean_velocity(shown), at.velocity, rtol=1e-5)
    np.testing.assert_allclose(np.mean(shown.luminance), at.luminance, rtol=1e-5)


def test_an_oracle_judges_for_the_display_of_the_sliders(drawn, spectra):
    at = PLACES[2]._replace(ppd=45.0)
    shown = _frame_map.adapted(drawn.frame, at)
    found = np.asarray(_frame_map.qualities(drawn.judge, shown, at))
    tile = 500
    place = np.unravel_index(tile, shown.shape)
    spectrum = list(spectra.values())[int(shown.texture[place])]
    seen = display(at._replace(luminance=shown.luminance[place]))
    sides = RATES.resolution

    def along(spectrum, velocity, rate_x, rate_y):
        level = shown.mip_level[place]
        shading = Shading(rate_x=rate_x, rate_y=rate_y, mip_level=level)
        return quality(spectrum, seen, Viewing(velocity[place]), shading)

    x = along(spectrum, shown.velocity_x, sides[:, 0], sides[:, 1])
    y = along(spectrum.transposed(), shown.velocity_y, sides[:, 1], sides[:, 0])
    np.testing.assert_allclose(found[tile], (x + y) / 2, rtol=0, atol=0.005)


MARRR = "MARRR (Denes et al. 2020)"


@pytest.mark.parametrize("at", PLACES)
def test_marrr_judges_for_the_display_of_the_sliders(drawn, at):
    at = at._replace(ppd=45.0)
    shown = _frame_map.adapted(drawn.frame, at)
    found = np.asarray(_frame_map.qualities(drawn.oracles[MARRR], shown, at))
    oracle = Denes2020Oracle(ppd=45.0, persistence=at.persistence)
    expected = np.asarray(oracle.quality(shown, at.refresh_rate))
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)
    # Of every rate its own, whatever the tile shows.
    assert found.shape == (920, 7) and np.ptp(found, axis=0).max() == 0
    assert np.ptp(found[0]) > 0


@pytest.mark.parametrize("name", ["CaMoJAB", "FidelityFX", MARRR, "uniform"])
@pytest.mark.parametrize("budget", [0.0625, 0.3, 1.0])
def test_rates_are_the_best_within_the_budget(drawn, name, budget):
    at = PLACES[0]
    shown = _frame_map.adapted(drawn.frame, at)
    judged = _frame_map.qualities(drawn.judge, shown, at)
    bought = _frame_map.qualities(drawn.oracles[name], shown, at)
    found = _frame_map.rate_map(bought, judged, budget, shown.shape)
    assert found.rate.shape == (23, 40) and found.cost <= budget + 1e-6
    count = np.array([np.mean(found.rate == i) for i in range(len(RATES))])
    np.testing.assert_allclose(found.shares, count)
    np.testing.assert_allclose(found.cost, count @ RATES.cost / 256, rtol=1e-5)
    lost = np.asarray(judged)[np.arange(920), found.rate.ravel()]
    expected = np.mean(np.asarray(judged)[:, -1] - lost)
    np.testing.assert_allclose(found.loss, expected, rtol=1e-4, atol=1e-6)
    full = RATES.cost.astype(bought.dtype)
    best = lagrangian(bought, full, budget * 256 * 920, throw=False)
    total = np.asarray(bought)[np.arange(920), found.rate.ravel()].sum()
    np.testing.assert_allclose(total, best.quality, rtol=1e-4, atol=1e-3)


def test_published_textures_are_offered_only_where_they_are(monkeypatch, tmp_path):
    def refused():
        raise AssertionError("read, or even downloaded")

    builtin = {"grass": np.zeros((512, 512))}
    monkeypatch.setattr(datasets, "builtin_textures", lambda: builtin)
    monkeypatch.setattr(datasets, "jindal2021_textures", refused)
    monkeypatch.setenv("CAMOJAB_DATA_DIR", str(tmp_path))
    assert list(_library.textures()) == ["grass"]
    monkeypatch.delenv("CAMOJAB_DATA_DIR")
    monkeypatch.setattr("pooch.os_cache", lambda _: tmp_path)
    assert list(_library.textures()) == ["grass"]

    path = tmp_path / "jindal2021" / "Experiment_Data" / "vrs_exp_stimulus.mat"
    path.parent.mkdir(parents=True)
    path.write_bytes(b"")
    published = {"noise": np.ones((512, 512))}
    monkeypatch.setattr(datasets, "jindal2021_textures", lambda: published)
    assert list(_library.textures()) == ["grass", "jindal2021:noise"]
