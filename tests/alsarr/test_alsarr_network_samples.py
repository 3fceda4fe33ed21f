import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.capture import Camera, save_view, View
from alsarr.metrics import METRICS
from alsarr.network import load_samples
from toy_samples import toy_samples


# Samples are bytes and single precision whatever the lane.
pytestmark = pytest.mark.float64

WIDTH, HEIGHT = 40, 24
OUTPUTS = ("2x1", "2x2")
CHANNELS = ("reprojected_green", "normal_x", "roughness", "reflect", "shadow")


def _view(seed, scene="room", width=WIDTH, height=HEIGHT):
    random = np.random.default_rng(seed)
    size = (height, width)
    camera = Camera(position=(0.0, 0.0, 0.0), forward=(0.0, 0.0, -1.0))
    byte = lambda *shape: random.integers(0, 256, shape, dtype=np.uint8)
    normal = random.normal(size=(*size, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    zeros = lambda *shape: np.zeros((*size, *shape), np.float32)
    return View(
        images=byte(7, *size, 3),
        normal=normal.astype(np.float16),
        diffuse=byte(*size, 3),
        specular=byte(*size, 3),
        roughness=byte(*size),
        depth=np.ones(size, np.float32),
        uv=zeros(2),
        texture=np.zeros(size, np.uint16),
        mip_level=np.zeros(size, np.float16),
        shadow=byte(*size),
        motion=zeros(2),
        reprojected=byte(*size, 3),
        seen=random.uniform(size=size) < 0.5,
        invocations=np.zeros(7, np.int32),
        exposure=np.ones((), np.float32),
        time=np.zeros((), np.float32),
        camera=camera,
        previous_camera=camera,
        scene=scene,
    )


def _folder(path, views):
    path.mkdir()
    paths = [path / f"view_{i:05d}.npz" for i in range(len(views))]
    for file, view in zip(paths, views, strict=True):
        save_view(file, view)
    return paths


class Counted:
    """A metric that is its own: the mean difference of a tile's reds."""

    def __init__(self):
        self.traces = 0

    def __call__(self, reference, test, *, ppd):
        self.traces += 1
        difference = jnp.abs(reference - test)[..., 0] * ppd
        padded = jnp.pad(difference, ((0, 8), (0, 8))).reshape(2, 16, 3, 16)
        return padded.sum(axis=(1, 3)) / 256


@pytest.fixture(scope="module")
def views():
    return [_view(0), _view(1, "yard"), _view(2)]


def _loaded(paths, **choices):
    settings = {"metric": "own", "ppd": 2.0, "outputs": OUTPUTS}
    return load_samples(paths, **settings | choices)


def test_samples_are_what_the_views_hold(tmp_path, views):
    paths = _folder(tmp_path / "a", views)
    done = []
    samples = load_samples(
        paths,
        metric="psnr",
        ppd=30.0,
        channels=CHANNELS,
        outputs=OUTPUTS,
        progress=lambda *counts: done.append(counts),
    )
    assert done == [(1, 3), (2, 3), (3, 3)]
    assert samples.scenes == ("room", "yard", "room")
    assert samples.names == tuple(map(str, paths))
    assert (samples.metric, samples.outputs, len(samples)) == ("psnr", OUTPUTS, 3)
    for i, view in enumerate(views):
        got = samples.picture(CHANNELS, i)
        assert got.dtype == np.float32 and got.shape == (5, 32, 48)
        stored = view.channels(CHANNELS)
        for plane, name in zip(got, CHANNELS, strict=True):
            # Half precision of a cosine, where it is not stored as it was.
            loss = 5e-4 if name == "reflect" else 1e-7
            padded = np.pad(stored[name], [(0, 8), (0, 8)], mode="edge")
            np.testing.assert_allclose(plane, padded, atol=loss, err_msg=name)
        light = view.images / np.float32(255)
        for rate, values in zip(OUTPUTS, samples.targets[i], strict=True):
            test = light[RATES.names.index(rate)]
            expected = METRICS["psnr"](light[6], test, ppd=30.0)
            np.testing.assert_allclose(values, expected, rtol=1e-5)


def test_a_metric_is_called_with_plain_arrays(tmp_path, views, monkeypatch):
    paths, seen = _folder(tmp_path / "a", views[:2]), []

    def flip(reference, test, *, ppd):
        seen.append((reference, test))
        return METRICS["flip"](reference, test, ppd=ppd)

    monkeypatch.setattr("alsarr.metrics.METRICS", {"flip": flip})
    samples = load_samples(paths, metric="flip", ppd=9.0, outputs=OUTPUTS)
    # In a program of its own FLIP would be several times as slow.
    assert len(seen) == 4 and not isinstance(seen[0][0], jax.core.Tracer)
    light = views[1].images / np.float32(255)
    expected = METRICS["flip"](light[6], light[RATES.names.index("2x1")], ppd=9.0)
    np.testing.assert_allclose(samples.targets[1, 0], expected, rtol=1e-5)


def test_a_metric_of_ones_own_may_be_numpys_or_compiled(tmp_path, views):
    paths = _folder(tmp_path / "a", views[:1])

    def worst(reference, test, *, ppd):
        apart = np.abs(np.asarray(reference) - np.asarray(test)).max(axis=2)
        padded = np.pad(apart, ((0, 8), (0, 8))).reshape(2, 16, 3, 16)
        return padded.max(axis=(1, 3))

    compiled = jax.jit(Counted(), static_argnames="ppd")
    for function in (worst, compiled, lambda r, t, *, ppd: worst(r, t, ppd=ppd) / 2):
        found = _loaded(paths, function=function, keep=False).targets
        assert found.shape == (1, 2, 2, 3) and found.min() > 0


def test_one_black_place_leaves_the_mean_as_it_is(tmp_path, views):
    plain = _loaded(_folder(tmp_path / "a", views), metric="jnflip", ppd=9.0)
    assert plain.mean() == plain.targets.mean()
    dark = _view(1)
    dark.images[-1, 4:8, 20:24] = 0
    views = [views[0], dark, views[2]]
    spoilt = _loaded(_folder(tmp_path / "b", views), metric="jnflip", ppd=9.0)
    black = spoilt.targets > 1e6
    assert black.sum() == 2 and black[1, :, 0, 1].all()
    assert spoilt.targets.mean() > 1e6
    assert spoilt.mean() == spoilt.targets[~black].mean()
    np.testing.assert_allclose(spoilt.mean(), plain.mean(), rtol=0.1)


@pytest.mark.parametrize(
    "values, mean",
    [
        ([0, 0, 0, 0], 0),
        ([0, 0, 1, 3], 1),
        # Of those above 0 the median is 1, however many are 0.
        ([0, 1, 1, 10_000], 10_002 / 4),
        ([0, 1, 1, 10_001], 2 / 3),
        ([1, 1, 3, np.inf], 5 / 3),
        ([np.inf] * 4, 0),
    ],
)
def test_what_the_mean_counts(values, mean):
    targets = np.asarray(values, np.float32).reshape(1, 2, 1, 2)
    samples = dataclasses.replace(toy_samples(1, rows=1, columns=2), targets=targets)
    np.testing.assert_allclose(samples.mean(), mean, rtol=1e-6)


def test_a_tile_is_seen_if_half_of_its_pixels_are(tmp_path):
    view = _view(0)
    seen = np.zeros((HEIGHT, WIDTH), bool)
    seen[:8, :16] = True  # half of the first tile
    seen[:8, 16:31] = True  # a little less of the second
    seen[16:, 32:36] = True  # half of the last, of which an eighth is there
    object.__setattr__(view, "seen", seen)
    paths = _folder(tmp_path / "a", [view])
    samples = _loaded(paths, function=Counted(), keep=False)
    expected = [[[True, False, False], [False, False, True]]]
    np.testing.assert_array_equal(samples.seen, expected)


def test_memory_is_a_byte_a_pixel(tmp_path, views):
    samples = _loaded(_folder(tmp_path / "a", views), function=Counted(), keep=False)
    kinds = {name: x.dtype for name, x in samples.inputs.items()}
    assert kinds.pop("normal_z") == np.float16
    assert set(kinds.values()) == {np.dtype(np.uint8)}
    # 500 views of 640x368 with four channels: 0.6 GB, and their targets.
    inputs = sum(x.nbytes for x in samples.inputs.values()) / (3 * 32 * 48)
    assert 500 * 640 * 368 * inputs + 500 * 4 * 23 * 40 * 4 < 0.7e9


def test_the_metric_is_computed_once(tmp_path, views):
    paths = _folder(tmp_path / "a", views) + _folder(tmp_path / "b", views[:1])
    first = _loaded(paths, function=Counted())
    again = Counted()
    kept = _loaded(paths, function=again)
    assert again.traces == 0
    np.testing.assert_array_equal(first.targets, kept.targets)
    names = {p.name for p in (tmp_path / "a").iterdir()} - {p.name for p in paths}
    assert names == {"targets_own_2.0_2x1_2x2.npz"}
    assert (tmp_path / "b" / "targets_own_2.0_2x1_2x2.npz").is_file()
    # Another ppd, rate or metric is another file; a single one need not be kept.
    for choices in ({"ppd": 3.0}, {"outputs": OUTPUTS[:1]}, {"metric": "other"}):
        other = Counted()
        _loaded(paths[:1], function=other, **choices)
        assert other.traces > 0
    assert len(list((tmp_path / "a").glob("targets_*"))) == 4
    unkept = Counted()
    _loaded(paths[:1], function=unkept, keep=False)
    assert unkept.traces > 0


def test_a_view_that_changed_is_computed_anew(tmp_path, views):
    paths = _folder(tmp_path / "a", views)
    _loaded(paths, function=Counted())
    save_view(paths[1], _view(9))
    anew = Counted()
    samples = _loaded(paths, function=anew)
    assert anew.traces > 0
    fresh = _loaded(paths, function=Counted(), keep=False)
    np.testing.assert_array_equal(samples.targets, fresh.targets)


def test_a_damaged_file_of_the_metric_is_computed_anew(tmp_path, views):
    paths = _folder(tmp_path / "a", views[:1])
    first = _loaded(paths, function=Counted())
    (file,) = (tmp_path / "a").glob("targets_*")
    file.write_bytes(file.read_bytes()[:100])
    again = Counted()
    np.testing.assert_array_equal(_loaded(paths, function=again).targets, first.targets)
    assert again.traces > 0


def test_what_was_computed_before_an_interruption_is_kept(tmp_path, views):
    paths = _folder(tmp_path / "a", views)

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _loaded(paths, function=Counted(), progress=stop)
    rest = Counted()
    _loaded(paths[:2], function=rest)
    assert rest.traces == 0


def test_held_out_views_are_of_every_scene():
    one, two = toy_samples(6), toy_samples(4, scene="other")
    mixed = type(one)(
        inputs={k: np.concatenate([v, two.inputs[k]]) for k, v in one.inputs.items()},
        targets=np.concatenate([one.targets, two.targets]),
        seen=np.concatenate([one.seen, two.seen]),
        names=one.names + two.names,
        scenes=one.scenes + two.scenes,
        outputs=one.outputs,
        metric="toy",
        ppd=60.0,
    )
    kept, held = mixed.split(2, seed=3)
    assert (len(kept), len(held)) == (6, 4)
    assert held.scenes.count("toy") == held.scenes.count("other") == 2
    assert set(kept.names) | set(held.names) == set(mixed.names)
    assert mixed.split(2, seed=3)[1].names == held.names
    assert any(mixed.split(2, seed=s)[1].names != held.names for s in range(4, 8))
    other = mixed.of_scene("other")
    assert other.names == two.names
    np.testing.assert_array_equal(other.targets, two.targets)
    np.testing.assert_array_equal(other.inputs["seen"], two.inputs["seen"])
    with pytest.raises(ValueError, match="`scene` must be one of other, toy, got moon"):
        mixed.of_scene("moon")
    for count in (0, 4):
        with pytest.raises(ValueError, match="`held_out` must be > 0 and less"):
            mixed.split(count, seed=0)


def test_what_cannot_be_loaded(tmp_path, views):
    paths = _folder(tmp_path / "a", [views[0], _view(3, width=48)])
    with pytest.raises(ValueError, match="`paths` must name at least one view"):
        _loaded([])
    with pytest.raises(ValueError, match=r"`paths` must be views of one size, got"):
        load_samples(paths, metric="psnr", ppd=30.0)
    with pytest.raises(ValueError, match="`metric` must be one of flip, .*, got own"):
        _loaded(paths)
    with pytest.raises(ValueError, match="`ppd` must be > 0 px/deg, got 0"):
        _loaded(paths, ppd=0.0)
    with pytest.raises(ValueError, match="`outputs` must be coarse rates, got 1x1"):
        _loaded(paths, outputs=("1x1",), function=Counted())
    with pytest.raises(ValueError, match="`names` must be of"):
        _loaded(paths, channels=("emissive",), function=Counted())
    nothing = lambda reference, test, *, ppd: jnp.full((2, 3), jnp.nan)
    with pytest.raises(ValueError, match="`metric` must be a number everywhere"):
        _loaded(paths[:1], function=nothing)
