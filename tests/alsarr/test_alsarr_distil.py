"""Tables made from the model: what is sampled, in which direction, with which error."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.tables import _distil as module, distil, Grid
from camojab import (
    Display,
    Formulation,
    Parameters,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


X64 = jax.config.read("jax_enable_x64")
# Enough to determine the first factor of Eq. 31; the second one passes through two.
GRID = Grid(
    velocity=(0.0, 20.0, 50.0),
    refresh_rate=(30.0, 60.0, 120.0),
    log10_luminance=(-1.0, 2.5),
)
PPD = 50.0


@functools.cache
def texture(kind):
    """Not the same in x as in y."""
    noise = np.random.default_rng(4).random((512, 512))
    if kind == "noise":
        return noise
    wave = np.sin(np.arange(512) * 2 * np.pi / 20)[None, :]
    return 0.5 + 0.4 * wave * np.linspace(0, 1, 512)[:, None] + 0.02 * noise


@functools.cache
def tables(kinds=("noise", "wave"), levels=(0, 2), *, turned=False, **more):
    turn = lambda x: x.T if turned else x
    spectra = {k: Spectrum.from_texture(turn(texture(k))) for k in kinds}
    return distil(spectra, mip_levels=levels, ppd=PPD, grid=GRID, **more)


def samples():
    mesh = np.meshgrid(*vars(GRID).values(), indexing="ij")
    return [x.ravel() for x in mesh]


def gains(image, resolution, level):
    """Quality of all rates relative to 4x4 in every sample, by the exact model."""
    velocity, refresh_rate, log_light = samples()
    found = quality(
        Spectrum.from_texture(image),
        Display(
            ppd=PPD, refresh_rate=refresh_rate[None], luminance=10 ** log_light[None]
        ),
        Viewing(velocity[None]),
        Shading(
            rate_x=resolution[:, :1],
            rate_y=resolution[:, 1:],
            mip_level=np.full((7, 1), float(level)),
        ),
    )
    return np.asarray(found) - np.asarray(found)[:1]


def eq31(w):
    v, f, z = samples()
    w = np.asarray(w, float)[..., None]
    w = [w[..., i, :] for i in range(10)]
    motion = w[0] + w[1] * v + w[2] * f + w[3] * v**2 + w[4] * v * f + w[5] * f**2
    return motion * (w[6] * z**3 + w[7] * z**2 + w[8] * z + w[9])


def test_the_reported_errors_are_those_against_the_exact_model():
    """Direction y is the transposed texture with the sides of the pixel swapped."""
    made = tables(("wave",), (2,))
    image = texture("wave")
    exact = np.stack(
        [
            gains(image, RATES.resolution, 2),
            gains(image.T, RATES.resolution[:, ::-1], 2),
        ],
        axis=1,
    )
    # The two directions are far from the same here, and so are 2x1 and 1x2.
    assert np.abs(exact[:, 0] - exact[:, 1]).max() > 0.5
    fitted = eq31(made.coefficients[0, 0])
    error = np.abs(fitted - exact)[1:]
    rtol = 1e-6 if X64 else 1e-3
    np.testing.assert_allclose(made.largest_error, error.max(), rtol=rtol)
    np.testing.assert_allclose(
        made.median_error, np.median(error), rtol=rtol, atol=0 if X64 else 1e-4
    )
    # Errors are of a useful fit: a tenth of what there is to tell.
    assert error.max() < 0.2 * np.abs(exact).max()


def test_qualities_are_relative_to_the_coarsest_rate():
    np.testing.assert_array_equal(eq31(tables().coefficients[:, :, 0]), 0)
    assert (np.abs(eq31(tables().coefficients[:, :, 1:])).max(axis=-1) > 0.01).all()


SWAPPED = [RATES.names.index("x".join(n.split("x")[::-1])) for n in RATES.names]


def test_turning_the_texture_swaps_the_directions():
    upright, turned = tables(), tables(turned=True)
    expected = eq31(upright.coefficients)[:, :, SWAPPED, ::-1]
    got = eq31(turned.coefficients)
    # The transform of a transposed texture rounds differently.
    np.testing.assert_allclose(got, expected, atol=1e-8 if X64 else 1e-3)
    assert SWAPPED == [0, 2, 1, 3, 5, 4, 6]


def test_textures_and_levels_are_in_their_places():
    """Each is what it would be alone."""
    both = tables()
    assert both.texture_names == ("noise", "wave")
    np.testing.assert_array_equal(both.mip_levels, [0, 2])
    for i, kind in enumerate(both.texture_names):
        for j, level in enumerate((0, 2)):
            alone = tables((kind,), (level,)).coefficients[0, 0]
            np.testing.assert_allclose(
                eq31(both.coefficients[i, j]),
                eq31(alone),
                atol=1e-9 if X64 else 1e-3,
            )
    apart = np.abs(np.diff(eq31(both.coefficients), axis=0)).max()
    assert apart > 0.1


def test_the_largest_error_is_that_of_the_worst_texture_and_level():
    single = [
        tables((kind,), (level,)) for kind in ("noise", "wave") for level in (0, 2)
    ]
    worst = max(float(one.largest_error) for one in single)
    rtol = 1e-6 if X64 else 1e-3
    np.testing.assert_allclose(tables().largest_error, worst, rtol=rtol)
    assert tables().median_error < tables().largest_error


def test_domain_and_model_say_what_was_sampled():
    made = tables()
    np.testing.assert_allclose(made.domain.velocity, [0, 50])
    np.testing.assert_allclose(made.domain.refresh_rate, [30, 120])
    np.testing.assert_allclose(made.domain.log10_luminance, [-1, 2.5])
    assert made.model.startswith("camojab released; ppd=50 [px/deg], ")
    assert Parameters.published().report() in made.model


def test_the_default_grid_is_the_authors():
    """ALSaRR/fit_polynomials of gfxdisp/ALSaRR at d06b3e0."""
    velocity, refresh_rate, log_light = Grid().samples()
    assert velocity.shape == (6 * 7 * 4,)
    assert sorted(set(velocity.tolist())) == [0, 10, 20, 30, 40, 50]
    assert sorted(set(refresh_rate.tolist())) == [30, 45, 60, 75, 90, 105, 120]
    assert sorted(set(log_light.tolist())) == [-1, 1, 2, 2.5]
    every = zip(
        velocity.tolist(), refresh_rate.tolist(), log_light.tolist(), strict=True
    )
    assert len(set(every)) == 168


def test_parameters_and_persistence_are_used():
    one = lambda **more: distil(
        {"noise": Spectrum.from_texture(texture("noise"))},
        mip_levels=(2,),
        ppd=PPD,
        grid=GRID,
        **more,
    )
    plain = eq31(tables(("noise",), (2,)).coefficients)
    published = Parameters.published()
    double = Parameters(ws=2 * published.ws, wt=2 * published.wt, beta=published.beta)
    twice = one(parameters=double)
    np.testing.assert_allclose(
        eq31(twice.coefficients), 2 * plain, atol=1e-8 if X64 else 1e-3
    )
    assert double.report() in twice.model
    short = one(persistence=0.1)
    assert np.abs(eq31(short.coefficients) - plain).max() > 0.1
    assert "persistence=0.1 [1]" in short.model


def test_the_formulation_brings_its_own_constants(monkeypatch):
    """Compiling the paper's formulation takes longer than all the rest here."""
    seen = []

    def sample(spectrum, shading, display, viewing, parameters, formulation):
        seen.append((parameters.report(), formulation))
        return jnp.arange(7.0)[:, None] * viewing.velocity[None]

    monkeypatch.setattr(module, "_sample", sample)
    formulation = Formulation.PAPER
    published = Parameters.published(formulation).report()
    made = distil(
        {"flat": flat()["flat"]},
        mip_levels=(2,),
        ppd=PPD,
        grid=GRID,
        formulation=formulation,
    )
    assert seen == [(published, formulation)] * 2
    assert made.model.startswith("camojab paper; ") and published in made.model


FLAT = {name: np.full((8, 8), 0.5) for name in ("flat", "too")}


def flat():
    return {name: Spectrum.from_texture(image) for name, image in FLAT.items()}


def test_progress_counts_pairs_of_texture_and_level():
    seen = []
    progress = lambda *n: seen.append(n)
    distil(flat(), mip_levels=(0, 2), ppd=PPD, grid=GRID, progress=progress)
    assert seen == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"ppd": 0.0}, "`ppd` must be finite and > 0 px/deg, got 0"),
        ({"persistence": 1.5}, r"`persistence` must be in \(0, 1\], got 1.5"),
        ({"mip_levels": (-1, 0)}, "`mip_level` must be finite and >= 0, got -1"),
        ({"mip_levels": (2, 0)}, "`mip_levels` must be one or more, rising"),
        ({"mip_levels": ()}, "`mip_levels` must be one or more, rising"),
        ({"grid": Grid(velocity=(-1.0,))}, "`velocity` must be finite and >= 0"),
        ({"grid": Grid(refresh_rate=(0.0,))}, "`refresh_rate` must be finite and > 0"),
    ],
)
def test_what_cannot_be_distilled(changes, message):
    given = {"mip_levels": (0, 2), "ppd": PPD, "grid": GRID} | changes
    with pytest.raises(ValueError, match=message):
        distil(flat(), **given)


def test_no_textures_are_refused():
    with pytest.raises(ValueError, match="`textures`"):
        distil({}, mip_levels=(0,), ppd=PPD, grid=GRID)
