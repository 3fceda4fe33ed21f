"""What is sampled of the model, in which direction, and how it goes on after a stop."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.tables import _samples as module, Domain, Grid, sample, Scene
from alsarr.tables._checkpoint import forget
from camojab import (
    Auto,
    Display,
    error_estimate,
    Exact,
    Formulation,
    Parameters,
    Pooled,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


X64 = jax.config.read("jax_enable_x64")
PPD = 50.0
GRID = Grid(
    velocity=(0.0, 7.0, 50.0), refresh_rate=(30.0, 120.0), log10_luminance=(-1.0, 2.5)
)
FIDELITY = Pooled(2000)


@functools.cache
def texture(kind):
    """Not the same in x as in y."""
    noise = np.random.default_rng(4).random((512, 512))
    if kind == "noise":
        return noise
    wave = np.sin(np.arange(512) * 2 * np.pi / 20)[None, :]
    return 0.5 + 0.4 * wave * np.linspace(0, 1, 512)[:, None] + 0.02 * noise


@functools.cache
def spectrum(kind, *, turned=False):
    return Spectrum.from_texture(texture(kind).T if turned else texture(kind))


TWO = Scene(2, ((0, 0.0), (1, 2.0)), GRID.domain)


@pytest.fixture(scope="module")
def both():
    """Two pairs at all seven rates."""
    return sample(
        {kind: spectrum(kind) for kind in ("noise", "wave")},
        TWO,
        ppd=PPD,
        grid=GRID,
        fidelity=FIDELITY,
    )


def some(samples):
    """Conditions of the grid and held out, and their places among all."""
    n = samples.grid.velocity.size
    places = np.array([0, 3, 5, n - 1, n, n + 77, n + 500, -3, -1])
    at = [
        np.concatenate([np.asarray(a, float), np.asarray(b, float)])[places]
        for a, b in zip(samples.grid, samples.held_out, strict=True)
    ]
    return places, at


def model(of, resolution, level, at, **more):
    velocity, refresh_rate, log_light = (x[None] for x in at)
    args = (
        of,
        Display(ppd=PPD, refresh_rate=refresh_rate, luminance=10**log_light),
        Viewing(velocity),
        Shading(
            rate_x=resolution[:, :1], rate_y=resolution[:, 1:], mip_level=float(level)
        ),
    )
    return np.asarray(quality(*args, **more)), args


@pytest.mark.parametrize("pair", [0, 1])
def test_samples_are_the_models_in_both_directions(both, pair):
    """Direction y is the transposed texture with the sides of the pixel swapped."""
    assert both.quality.shape == (2, 7, 2, 12 + 1032)
    kind, level = [("noise", 0), ("wave", 2)][pair]
    places, at = some(both)
    for direction in range(2):
        resolution = RATES.resolution[:, :: 1 - 2 * direction]
        of = spectrum(kind, turned=direction == 1)
        exact, args = model(of, resolution, level, at)
        got = both.quality[pair, :, direction][:, places]
        estimate = error_estimate(*args, fidelity=FIDELITY)
        assert estimate < 0.2
        np.testing.assert_allclose(got, exact, rtol=0, atol=estimate)
    # The directions of the wave are far apart, and so are 2x1 and 1x2.
    apart = np.abs(both.quality[1, 4] - both.quality[1, 5]).max()
    assert apart > 0.5 and np.abs(np.diff(both.quality[1], axis=1)).max() > 0.5


def test_conditions_are_those_of_the_grid_then_the_held_out(both):
    assert len(both.grid.velocity) == 12 and len(both.held_out.velocity) == 1032
    for ours, theirs in zip(both.grid, GRID.conditions(), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert both.texture_names == ("noise", "wave") and both.rates == RATES.names
    assert both.scene is TWO and both.ppd == PPD
    assert both.model.startswith("camojab released; ppd=50 [px/deg], ")
    assert Parameters.published().report() in both.model


def test_separable_rates_are_square_pixels(both):
    """Half of `2x2` among the seven, and so of the others."""
    sides = sample(
        {"wave": spectrum("wave")},
        Scene(1, ((0, 2.0),), GRID.domain),
        ppd=PPD,
        grid=GRID,
        fidelity=FIDELITY,
        rates=("4", "2", "1"),
    )
    squares = [RATES.names.index(name) for name in ("4x4", "2x2", "1x1")]
    np.testing.assert_allclose(
        sides.quality[0],
        both.quality[1][squares],
        rtol=0,
        atol=1e-6 if X64 else 1e-4,
    )
    assert sides.rates == ("4", "2", "1")


def pretend(spectrum, rates, display, viewing, parameters, formulation, fidelity):
    """Another model, which takes no time but tells its arguments apart."""
    del formulation, fidelity
    at = viewing.velocity + display.refresh_rate + jnp.log(display.luminance)
    corner = spectrum.amplitude[200, 300] - 2 * spectrum.amplitude[300, 200]
    each = rates.rate_x + 3 * rates.rate_y + 7 * rates.mip_level + corner
    return parameters.ws * each[:, None] * at[None] * display.persistence


@pytest.fixture
def pretended(monkeypatch):
    """Count the pairs that are computed."""
    monkeypatch.setattr(module, "_quality", pretend)
    over, computed = module._over, []

    def counting(devices, *rest):
        run = over(devices, *rest)

        def counted(pairs, shared):
            computed.append(len(devices))
            return run(pairs, shared)

        return counted

    monkeypatch.setattr(module, "_over", counting)
    return computed


FOUR = Scene.every(2, (0, 2), GRID.domain)


def pretended_samples(checkpoint=None, **changes):
    textures = {kind: spectrum(kind) for kind in ("noise", "wave")}
    given = {"ppd": PPD, "grid": GRID, "checkpoint": checkpoint} | changes
    scene = given.pop("scene", FOUR)
    return sample(textures, scene, **given)


def stopping(after):
    """Progress that is interrupted when so many pairs are done."""

    def progress(done, total):
        if done == after:
            raise KeyboardInterrupt

    return progress


def test_an_interrupted_run_goes_on_where_it_was(tmp_path, pretended):
    whole = pretended_samples()
    assert len(pretended) == 4
    pretended.clear()
    folder = tmp_path / "half"
    for after, done in ((2, 2), (3, 1)):
        with pytest.raises(KeyboardInterrupt):
            pretended_samples(folder, progress=stopping(after))
        assert len(pretended) == done
        pretended.clear()
    seen = []
    again = pretended_samples(folder, progress=lambda *n: seen.append(n))
    assert len(pretended) == 1 and seen == [(3, 4), (4, 4)]
    assert again.quality.tobytes() == whole.quality.tobytes()
    pretended.clear()
    once_more = pretended_samples(folder)
    assert not pretended
    assert once_more.quality.tobytes() == whole.quality.tobytes()


@pytest.mark.parametrize(
    "changes",
    [
        {"ppd": 51.0},
        {"persistence": 0.5},
        {"rates": ("2x2", "1x1")},
        {"fidelity": Pooled(400)},
        {"formulation": Formulation.PAPER},
        {"parameters": Parameters(ws=-1.0, wt=-1.0, beta=0.4)},
        {"scene": Scene.every(2, (0, 3), GRID.domain)},
        {"grid": Grid(*((*axis, 2.0) for axis in vars(GRID).values()))},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_checkpoint_of_another_task_is_thrown_away(tmp_path, pretended, changes):
    with pytest.raises(KeyboardInterrupt):
        pretended_samples(tmp_path, progress=stopping(3))
    pretended.clear()
    got = pretended_samples(tmp_path, **changes)
    assert len(pretended) == 4
    want = pretended_samples(**changes)
    assert got.quality.tobytes() == want.quality.tobytes()


def test_a_checkpoint_of_other_textures_is_thrown_away(tmp_path, pretended):
    pretended_samples(tmp_path)
    pretended.clear()
    turned = {kind: spectrum(kind, turned=True) for kind in ("noise", "wave")}
    sample(turned, FOUR, ppd=PPD, grid=GRID, checkpoint=tmp_path)
    assert len(pretended) == 4


def spoilt(content):
    """Ways to damage a file of results."""
    short, wide = content[:-7], content + b"0" * 9
    altered = bytearray(content)
    altered[len(content) // 2] ^= 1
    shape = np.zeros((1, 2, 3), np.float32)
    objects = np.empty(1, object)
    return {
        "cut": short,
        "empty": b"",
        "text": b"none",
        "head": wide[1:],
        "bit": bytes(altered),
    }, {
        "shape": shape,
        "nan": np.full((7, 2, 1044), np.nan, np.float32),
        "pickle": objects,
    }


def test_a_damaged_result_is_computed_again(tmp_path, pretended):
    whole = pretended_samples(tmp_path)
    path = sorted(tmp_path.glob("*.npz"))[2]
    good = path.read_bytes()
    contents, arrays = spoilt(good)
    for content in contents.values():
        path.write_bytes(content)
        pretended.clear()
        again = pretended_samples(tmp_path)
        assert len(pretended) == 1 and path.read_bytes() == good
        assert again.quality.tobytes() == whole.quality.tobytes()
    for array in arrays.values():
        np.savez(path, result=array)
        pretended.clear()
        again = pretended_samples(tmp_path)
        assert len(pretended) == 1 and path.read_bytes() == good
        assert again.quality.tobytes() == whole.quality.tobytes()


def test_a_folder_with_other_files_is_refused_and_left_alone(tmp_path, pretended):
    (tmp_path / "thesis.npy").write_text("years of work")
    with pytest.raises(ValueError, match="`checkpoint` must be a folder of its own"):
        pretended_samples(tmp_path)
    forget(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.npy"] and not pretended


def test_a_checkpoint_is_forgotten_whole(tmp_path, pretended):
    folder = tmp_path / "done"
    pretended_samples(folder)
    assert len(list(folder.glob("*.npz"))) == 4
    forget(folder)
    assert not folder.exists()
    forget(folder)


def test_progress_counts_the_pairs(pretended):
    seen = []
    pretended_samples(progress=lambda *n: seen.append(n))
    devices = len(jax.local_devices())
    starts = [(done, 4) for done in range(0, 4, devices)]
    assert seen == [*starts, (4, 4)]


def test_textures_levels_rates_and_directions_are_in_their_places(pretended):
    found = pretended_samples(rates=("2x1", "1x1"), persistence=0.5)
    every = [
        np.concatenate([np.asarray(a, float), np.asarray(b, float)])
        for a, b in zip(found.grid, found.held_out, strict=True)
    ]
    at = every[0] + every[1] + np.log(10 ** every[2])
    ws = float(Parameters.published().ws)
    for i, (t, level) in enumerate(FOUR.pairs):
        image = np.asarray(spectrum(found.texture_names[t]).amplitude, float)
        for k, (x, y) in enumerate([(0.5, 1.0), (1.0, 1.0)]):
            for d in range(2):
                a, sides = (image.T, (y, x)) if d else (image, (x, y))
                each = sides[0] + 3 * sides[1] + 7 * level + a[200, 300]
                expected = 0.5 * ws * (each - 2 * a[300, 200]) * at
                np.testing.assert_allclose(
                    found.quality[i, k, d], expected, rtol=1e-4, atol=1e-3
                )


def test_the_formulation_brings_its_own_constants(pretended):
    made = pretended_samples(formulation=Formulation.PAPER)
    published = Parameters.published(Formulation.PAPER)
    assert made.model.startswith("camojab paper; ") and published.report() in made.model
    plain = pretended_samples()
    ratio = float(published.ws / Parameters.published().ws)
    np.testing.assert_allclose(made.quality, ratio * plain.quality, rtol=1e-5)
    assert "persistence=0.1 [1]" in pretended_samples(persistence=0.1).model


def test_without_a_grid_the_scenes_domain_is_covered(pretended):
    made = pretended_samples(grid=None)
    assert made.grid.velocity.size == 17 * 9 * 8
    for values, ends in zip(made.grid, jax.tree.leaves(FOUR.domain), strict=True):
        assert values.min() == ends[0] and values.max() == ends[1]


def test_an_exact_model_can_be_sampled_too():
    grid = Grid(velocity=(7.0,), refresh_rate=(60.0,), log10_luminance=(1.5,))
    made = sample(
        {"wave": spectrum("wave")},
        Scene(1, ((0, 2.0),), grid.domain),
        ppd=PPD,
        grid=grid,
        fidelity=Exact(),
        rates=("2x1", "1x1"),
    )
    # A domain of one condition, which is tried again and again.
    assert made.quality.shape == (1, 2, 2, 1 + 1032)
    np.testing.assert_array_equal(made.held_out.velocity, 7)
    rates = RATES.resolution[[5, 6]]
    at = [np.array([x]) for x in (7.0, 60.0, 1.5)]
    for d in range(2):
        of = spectrum("wave", turned=d == 1)
        exact, _ = model(of, rates[:, :: 1 - 2 * d], 2, at, fidelity=Exact())
        np.testing.assert_allclose(
            made.quality[0, :, d, :1], exact, rtol=0, atol=1e-5 if X64 else 1e-3
        )


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"ppd": 0.0}, "`ppd` must be finite and > 0 px/deg, got 0"),
        ({"persistence": 1.5}, r"`persistence` must be in \(0, 1\], got 1.5"),
        ({"grid": Grid(velocity=(-1.0,))}, "`velocity` must be finite and >= 0"),
        ({"grid": Grid(refresh_rate=(0.0,))}, "`refresh_rate` must be finite and > 0"),
        ({"rates": ("4x4", "2x2")}, "`rates` must be some of .* got 4x4, 2x2"),
        ({"rates": ("1x1", "4x4")}, "`rates` must be some of .* in this order"),
        ({"rates": ("4", "1")}, "`rates` must be some of .* got 4, 1"),
        ({"scene": Scene.every(1)}, "`textures` must be as many as .*, 1, got 2"),
    ],
)
def test_what_cannot_be_sampled(changes, message, pretended):
    with pytest.raises(ValueError, match=message):
        pretended_samples(**changes)
    assert not pretended


def test_no_textures_are_refused():
    with pytest.raises(ValueError, match="`textures` must be as many as .*, 1, got 0"):
        sample({}, Scene.every(1), ppd=PPD)


def test_auto_takes_the_finest_rung_that_a_texture_needs(monkeypatch):
    """An empty texture needs the first; noise, whose errors are larger, the second."""
    noise = np.random.default_rng(0).random((512, 512))
    images = {"empty": np.zeros((8, 8)), "noise": noise}
    textures = {k: Spectrum.from_texture(v) for k, v in images.items()}
    taken = []

    def nothing(task, *_):
        taken.append(task.fidelity)
        return np.zeros((len(task.pairs), *task.shape), np.float32)

    monkeypatch.setattr(module, "_all", nothing)
    auto = Auto(0.005, rungs=(Pooled(400), Pooled(5000)))
    for names in (["empty"], ["empty", "noise"]):
        sample(
            {name: textures[name] for name in names},
            Scene.every(len(names), (0,), Domain(velocity=(0.0, 10.0))),
            ppd=PPD,
            fidelity=auto,
            rates=("2x2", "1x1"),
            grid=Grid(velocity=(0.0, 5.0)),
        )
    assert taken == [Pooled(400), Pooled(5000)]
