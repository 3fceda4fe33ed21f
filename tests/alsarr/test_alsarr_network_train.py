import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr.network import (
    _train as private,
    attribute,
    ClampedTransform,
    evaluate,
    initial_network,
    integrated_gradients,
    LogisticTransform,
    predictions,
    train,
    with_safety_offset,
)
from alsarr.network._loss import training_pass
from alsarr.network._model import EPSILON
from toy_samples import OUTPUTS, toy_samples


# Training is in single precision whatever the lane.
pytestmark = pytest.mark.float64


def _start(samples, seed=0, **choices):
    transform = ClampedTransform.from_mean(samples.targets.mean())
    names = {"metric": "toy", "ppd": 60.0, "outputs": OUTPUTS, "transform": transform}
    return initial_network(seed, **names | choices)


SMALL = {"latent": 4, "groups": (1, 2, 1), "region": 16}
"""A network that compiles quickly, for what does not depend on its size."""


@pytest.fixture(scope="module")
def learned():
    """The default network, and samples that it has not learned from."""
    samples, held_out = toy_samples(24).split(6, seed=1)
    losses = []
    training = train(
        _start(samples),
        samples,
        steps=150,
        batch=4,
        crop=(64, 64),
        learning_rate=3e-3,
        held_out=held_out,
        every=50,
        progress=lambda done, total, loss: losses.append((done, total, loss)),
    )
    return training, held_out, losses


@pytest.fixture(scope="module")
def few():
    return toy_samples(6, rows=2, columns=3)


def _same(one, other):
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(a, b)


def test_training_learns_the_toy(learned):
    training, held_out, losses = learned
    assert [row[:2] for row in losses] == [(i + 1, 150) for i in range(150)]
    loss = [row[2] for row in losses]
    assert np.mean(loss[-20:]) < 0.4 * np.mean(loss[:5])
    scores = {(s.output, s.tiles): s for s in evaluate(training.network, held_out)}
    assert scores["all", "all"].r2 > 0.85
    # Where the previous picture is missing the other inputs tell as much here.
    assert scores["all", "unseen"].r2 > 0.75


def test_the_history_is_what_was_measured(learned):
    training, held_out, losses = learned
    np.testing.assert_array_equal(training.history[:, 0], [50, 100, 150])
    means = [np.mean([row[2] for row in losses[i : i + 50]]) for i in (0, 50, 100)]
    np.testing.assert_allclose(training.history[:, 1], means, rtol=1e-9)
    best = np.argmin(training.history[:, 2])
    assert (training.step, training.steps) == (training.history[best, 0], 150)
    error = evaluate(training.network, held_out)[0].mae
    np.testing.assert_allclose(error, training.history[best, 2], rtol=1e-6)


def test_weights_stay_in_single_precision(learned):
    network = learned[0].network
    for leaf in jax.tree.leaves(network.blocks):
        assert leaf.dtype == jnp.float32
    start = _start(learned[1])
    assert jax.tree.structure(network) == jax.tree.structure(start)


def test_scores_are_what_numpy_makes_of_predictions(learned):
    network, held_out = learned[0].network, learned[1]
    factor = float(network.transform.factor)
    target = np.clip(held_out.targets.astype(float) * factor, 0, 1)
    error = predictions(network, held_out) - target
    scores = {(s.output, s.tiles): s for s in evaluate(network, held_out)}
    assert len(scores) == 9
    for output, tiles in scores:
        chosen = slice(None) if output == "all" else [OUTPUTS.index(output)]
        mask = np.broadcast_to(held_out.seen[:, None], error.shape)[:, chosen]
        if tiles != "seen":
            mask = ~mask | (tiles == "all")
        e, t = error[:, chosen][mask], target[:, chosen][mask]
        expected = {
            "count": mask.sum(),
            "r2": 1 - np.mean(e**2) / np.var(t),
            "mae": np.abs(e).mean(),
            "mae_under": -e[e < 0].sum() / e.size,
            "sigma": np.abs(e).std(),
        }
        for name, value in expected.items():
            got = getattr(scores[output, tiles], name)
            np.testing.assert_allclose(got, value, rtol=1e-5, err_msg=name)


def test_a_perfect_and_a_constant_network_score_one_and_nothing(few):
    network = _start(few, **SMALL)
    said = predictions(network, few)
    own = np.asarray(network.transform.inverse(jnp.asarray(said)))
    perfect = evaluate(network, dataclasses.replace(few, targets=own))[0]
    np.testing.assert_allclose([perfect.r2, perfect.mae], [1, 0], atol=1e-6)
    flat = evaluate(network, dataclasses.replace(few, targets=0 * few.targets))[0]
    assert np.isnan(flat.r2) and flat.mae_under == 0
    all_seen = dataclasses.replace(few, seen=np.ones_like(few.seen))
    unseen = evaluate(network, all_seen)[2]
    assert (unseen.tiles, unseen.count) == ("unseen", 0)
    assert np.isnan([unseen.r2, unseen.mae, unseen.mae_under, unseen.sigma]).all()


def test_the_safety_offset_is_the_mean_underestimation(learned):
    network, held_out = learned[0].network, learned[1]
    score = evaluate(network, held_out)[0]
    safe = with_safety_offset(network, held_out)
    np.testing.assert_allclose(safe.safety_offset, score.mae_under, rtol=1e-6)
    assert evaluate(safe, held_out)[0] == score
    assert evaluate(safe, held_out, safe=True)[0].mae_under < score.mae_under


def test_a_step_normalises_by_the_batch_and_follows_its_statistics(few):
    network = _start(few, **SMALL)
    x = jnp.asarray(np.stack([few.picture(network.channels, i) for i in range(2)]))
    y, statistics = jax.jit(training_pass)(network, x)
    assert y.shape == (2, 2, 2, 3)
    # In the first layer, by NumPy, from what the layer rectifies.
    first = network.blocks[0]
    last = jnp.moveaxis(network.prepared(x), 1, -1)
    rectified = np.asarray(first.rectified(last), np.float64)
    mean, variance = rectified.mean(axis=(0, 1, 2)), rectified.var(axis=(0, 1, 2))
    np.testing.assert_allclose(statistics[0][0], mean, rtol=1e-5)
    np.testing.assert_allclose(statistics[0][1], variance, rtol=1e-4)
    normal = first.finished(jnp.asarray(rectified, jnp.float32), *statistics[0])
    np.testing.assert_allclose(np.mean(normal, axis=(0, 1, 2)), 0, atol=1e-5)
    spread = variance / (variance + EPSILON)
    np.testing.assert_allclose(np.var(normal, axis=(0, 1, 2)), spread, rtol=1e-4)
    followed = private._following(network, statistics, 2 * 32 * 48).blocks
    np.testing.assert_allclose(followed[0].mean, 0.1 * mean, rtol=1e-5)
    pixels = 2 * 32 * 48
    unbiased = 0.9 + 0.1 * variance * pixels / (pixels - 1)
    np.testing.assert_allclose(followed[0].variance, unbiased, rtol=1e-5)


def test_the_first_step_is_rmsprops(few):
    """v = 0.01 g^2 after one step, so every weight moves by 10 rates against g."""
    network = _start(few, **SMALL)
    settings = {"steps": 1, "batch": 2, "flips": False, "learning_rate": 1e-3}
    plain = train(network, few, weight_decay=0.0, **settings).network
    moved = [
        np.asarray(a - b)
        for a, b in zip(*map(private._weights, (plain, network)), strict=True)
    ]
    values = np.abs(np.concatenate([m.ravel() for m in moved]))
    # A few have no slope; the rest, rounded to float32 beside weights of up to 1.
    assert np.mean(np.abs(values - 1e-2) < 2e-6) > 0.9
    # With a weight decay that outweighs any slope everything goes to 0.
    decayed = train(network, few, weight_decay=1e6, **settings).network
    for a, b in zip(*map(private._weights, (decayed, network)), strict=True):
        step, start = np.asarray(b - a), np.asarray(b)
        known = start != 0
        np.testing.assert_allclose(step[known], 1e-2 * np.sign(start[known]), atol=2e-6)


def test_the_learning_rate_decays(few):
    settings = {"batch": 2, "learning_rate": 1e-2, "learning_decay": 1e-6}
    one = train(_start(few, **SMALL), few, steps=1, **settings).network
    two = train(_start(few, **SMALL), few, steps=2, **settings).network
    for a, b in zip(*map(private._weights, (one, two)), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_an_interrupted_training_goes_on_with_the_same_numbers(few, tmp_path):
    samples, held_out = few.split(2, seed=0)
    path = tmp_path / "training.npz"
    settings = {
        **{"batch": 2, "every": 3, "held_out": held_out},
        **{"learning_rate": 1e-2, "learning_decay": 0.99, "running_mean": True},
    }
    start = _start(samples, **SMALL)
    whole = train(start, samples, steps=8, **settings)

    def stop(done, total, loss):
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(start, samples, steps=8, checkpoint=path, progress=stop, **settings)
    seen = []
    note = lambda done, total, loss: seen.append(done)
    rest = train(start, samples, steps=8, checkpoint=path, progress=note, **settings)
    assert seen == [5, 6, 7, 8]
    _same(rest.network, whole.network)
    np.testing.assert_array_equal(rest.history, whole.history)
    assert (rest.step, rest.steps) == (whole.step, whole.steps)
    # What is finished is not done again.
    again = train(start, samples, steps=8, checkpoint=path, progress=stop, **settings)
    _same(again.network, whole.network)
    assert [p.name for p in tmp_path.iterdir()] == ["training.npz"]


@pytest.mark.parametrize("steps, every, stopped", [(6, 2, 4), (4, 2, 4), (5, 2, 5)])
def test_an_evaluation_that_was_interrupted_is_made_up_for(
    few, tmp_path, monkeypatch, steps, every, stopped
):
    samples, held_out = few.split(2, seed=0)
    settings = {"batch": 2, "every": every, "held_out": held_out, "steps": steps}
    settings["learning_rate"] = 1e-2
    start = _start(samples, **SMALL)
    whole = train(start, samples, **settings)
    assert whole.step > 0
    judge, judged = private._held_out_error, []

    def interrupted(network, held_out):
        judged.append(network)
        if len(judged) == -(-stopped // every):
            raise KeyboardInterrupt
        return judge(network, held_out)

    settings["checkpoint"] = tmp_path / "training.npz"
    with monkeypatch.context() as patch:
        patch.setattr(private, "_held_out_error", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train(start, samples, **settings)
    rest = train(start, samples, **settings)
    _same(rest.network, whole.network)
    np.testing.assert_array_equal(rest.history, whole.history)
    assert (rest.step, rest.steps) == (whole.step, whole.steps)


@pytest.mark.parametrize("judged", [True, False])
def test_more_steps_may_be_asked_for(few, tmp_path, judged):
    """Where the fewer were not a multiple of those between evaluations."""
    samples, held_out = few.split(2, seed=0)
    settings = {"batch": 2, "every": 3, "learning_rate": 1e-2}
    settings |= {"held_out": held_out} if judged else {}
    start = _start(samples, **SMALL)
    whole = train(start, samples, steps=8, **settings)
    np.testing.assert_array_equal(whole.history[:, 0], [3, 6, 8])
    settings["checkpoint"] = tmp_path / "training.npz"
    for _ in range(2):
        fewer = train(start, samples, steps=4, **settings)
        np.testing.assert_array_equal(fewer.history[:, 0], [3, 4])
    more = train(start, samples, steps=8, **settings)
    _same(more.network, whole.network)
    np.testing.assert_array_equal(more.history, whole.history)
    assert (more.step, more.steps) == (whole.step, whole.steps)


def test_what_an_off_cycle_end_has_for_best_is_returned_but_not_kept(
    few, tmp_path, monkeypatch
):
    samples, held_out = few.split(2, seed=0)
    settings = {"batch": 2, "every": 3, "held_out": held_out, "patience": 2}
    settings["checkpoint"] = tmp_path / "training.npz"
    errors = iter([0.5, 0.1, 0.4, 0.6])
    monkeypatch.setattr(private, "_held_out_error", lambda *_: next(errors))
    start = _start(samples, **SMALL)
    assert train(start, samples, steps=4, **settings).step == 4
    assert train(start, samples, steps=9, **settings).step == 6


def test_a_checkpoint_of_another_training_is_refused(few, tmp_path):
    path = tmp_path / "training.npz"
    start = _start(few, **SMALL)
    train(start, few, steps=1, batch=2, checkpoint=path)
    with pytest.raises(ValueError, match=f"^{path}: `checkpoint` must be of the same"):
        train(start, few, steps=2, batch=2, seed=1, checkpoint=path)
    with pytest.raises(ValueError, match=f"^{path}: `checkpoint` must be of the same"):
        train(_start(few, 1, **SMALL), few, steps=2, batch=2, checkpoint=path)
    with pytest.raises(ValueError, match=f"^{path}: `checkpoint` must be of the same"):
        train(start, few.take(range(5)), steps=2, batch=2, checkpoint=path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ValueError, match=f"^{path}: is no NPZ file, or was cut off"):
        train(start, few, steps=2, batch=2, checkpoint=path)


def test_the_seed_decides(few):
    one, same, other = (
        train(_start(few, **SMALL), few, steps=2, batch=2, seed=seed).network
        for seed in (0, 0, 1)
    )
    _same(one, same)
    assert np.any(one.blocks[0].weight != other.blocks[0].weight)


def test_training_stops_early_and_returns_the_best(few):
    samples, held_out = few.split(2, seed=0)
    # What is learned makes these ever worse.
    worse = dataclasses.replace(held_out, targets=0 * held_out.targets)
    high = dataclasses.replace(samples, targets=np.ones_like(samples.targets))
    training = train(
        _start(few, **SMALL),
        high,
        held_out=worse,
        **{"steps": 60, "batch": 2, "every": 2, "patience": 3, "learning_rate": 1e-2},
    )
    best = int(np.argmin(training.history[:, 2]))
    assert training.steps == 2 * (best + 4) < 60
    assert training.step == 2 * (best + 1)
    error = evaluate(training.network, worse)[0].mae
    np.testing.assert_allclose(error, training.history[best, 2], rtol=1e-6)


def test_the_transform_follows_the_mean_of_what_was_seen(few):
    transform = ClampedTransform(9.0)
    one = few.take([2])
    network = _start(few, transform=transform, **SMALL)
    settings = {"steps": 2, "batch": 2, "crop": None}
    followed = train(network, one, running_mean=True, **settings).network
    expected = transform.at_mean(one.targets.mean(dtype=float))
    for a, b in zip(*map(jax.tree.leaves, (followed.transform, expected)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)
    _same(train(network, one, **settings).network.transform, transform)


@pytest.mark.parametrize("kind", [ClampedTransform, LogisticTransform])
def test_the_transform_waits_for_an_error_to_follow(few, kind):
    network = _start(few, transform=kind(0.5), **SMALL)
    settings = {"batch": 2, "running_mean": True}
    same = dataclasses.replace(few, targets=0 * few.targets)
    found = train(network, same, steps=2, **settings).network.transform
    _same(found, network.transform)
    # With this seed the two steps have no view in common.
    settings["seed"] = 3
    some = dataclasses.replace(few, targets=few.targets.copy())
    some.targets[[4, 0]] = 0
    mean = some.targets[[4, 0, 5, 1]].mean(dtype=float)
    found = train(network, some, steps=2, **settings).network.transform
    expected = network.transform.at_mean(mean)
    for a, b in zip(*map(jax.tree.leaves, (found, expected)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)


def test_a_black_place_does_not_move_the_running_mean(few):
    one = few.take([2])
    dark = dataclasses.replace(one, targets=one.targets.copy())
    dark.targets[0, 1, 0, 2] = 7e8
    network = _start(few, **SMALL)
    settings = {"steps": 1, "batch": 2, "running_mean": True}
    found = train(network, dark, **settings).network.transform
    rest = np.delete(one.targets.ravel(), 6 + 2).mean(dtype=float)
    expected = network.transform.at_mean(rest)
    np.testing.assert_allclose(found.factor, expected.factor, rtol=1e-6)


def test_one_compilation_serves_all_steps_and_rates(few, monkeypatch):
    traces = []

    def counted(network, x):
        traces.append(x.shape)
        return training_pass(network, x)

    monkeypatch.setattr(private, "training_pass", counted)
    start = _start(few, **SMALL)
    for rate in (1e-4, 1e-3):
        train(start, few, steps=3, batch=5, learning_rate=rate, running_mean=True)
    assert traces == [(5, 4, 32, 48)]


def test_crops_are_whole_tiles_and_mirrors_turn_the_normals():
    samples = toy_samples(3, rows=4, columns=5)
    shape = samples.inputs["seen"].shape
    place = np.arange(np.prod(shape[1:])).reshape(1, *shape[1:]) % 2039
    samples.inputs["normal_x"] = np.broadcast_to(place, shape).astype(np.float16)
    targets = samples.inputs["normal_x"][:, ::16, ::16].astype(np.float32)
    samples = dataclasses.replace(samples, targets=np.stack([targets] * 2, axis=1))
    settings = private._Settings(40, 0, (48, 32), True, None, 1)
    x, target = private._drawn(samples, ("diffuse_red", "normal_x"), settings, 7)
    assert x.shape == (40, 2, 32, 48) and target.shape == (40, 2, 2, 3)
    corner = lambda p: p[::16, ::16]
    mirrored = 0
    for picture, expected in zip(x, target, strict=True):
        if picture[1].min() < 0:
            mirrored += 1
            picture = -picture[:, :, ::-1]
            expected = expected[..., ::-1]
        np.testing.assert_array_equal(corner(picture[1]), expected[0])
    assert 8 < mirrored < 32
    assert np.all(x[:, 0] >= 0)
    assert len({float(p[1, 0, 0]) for p in x}) > 8
    still = private._Settings(40, 0, (48, 32), False, None, 1)
    assert private._drawn(samples, ("normal_x",), still, 7)[0].min() >= 0


def test_contributions_add_up_to_what_differs(learned):
    network, held_out = learned[0].network, learned[1]
    x = held_out.picture(network.channels, 0)
    baseline = np.full_like(x, 0.4)
    parts = integrated_gradients(network, x, baseline, steps=64)
    sums = eqx.filter_jit(lambda n, x: jnp.sum(n(x)))
    whole = sums(network, x) - sums(network, baseline)
    # The way crosses many corners of rectifiers and maxima.
    np.testing.assert_allclose(parts.sum(), whole, rtol=0.03)
    assert abs(float(whole)) > 1


def test_attributions_are_percentages_of_what_the_toy_depends_on(learned):
    network, held_out = learned[0].network, learned[1]
    found = attribute(network, held_out.take(range(2)), steps=4)
    assert found.channels == network.channels
    np.testing.assert_allclose([sum(found.seen), sum(found.unseen)], 100)
    seen, unseen = (
        dict(zip(found.channels, p, strict=True)) for p in (found.seen, found.unseen)
    )
    assert seen["normal_z"] == unseen["normal_z"] == unseen["reprojected_red"] == 0
    assert seen["diffuse_red"] > 20 and seen["reprojected_red"] > 5
    all_seen = dataclasses.replace(
        held_out.take([0]),
        inputs={**held_out.take([0]).inputs}
        | {"seen": np.full_like(held_out.take([0]).inputs["seen"], 255)},
    )
    assert np.isnan(attribute(network, all_seen, steps=1).unseen).all()
    with pytest.raises(ValueError, match="`steps` must be > 0, got 0"):
        attribute(network, held_out, steps=0)


@pytest.mark.parametrize(
    "choices, message",
    [
        ({"steps": 0}, "`steps` must be > 0, got 0"),
        ({"batch": 0}, "`batch` must be > 0, got 0"),
        ({"every": 0}, "`every` must be > 0, got 0"),
        ({"patience": 1}, "`patience` must be left out without `held_out`"),
        ({"crop": (24, 32)}, "`crop` must be positive multiples of 16 px, got 24x32"),
        ({"crop": (32, 0)}, "`crop` must be positive multiples of 16 px, got 32x0"),
        ({"crop": (32, 48)}, "`crop` must be at most 48x32 px, got 32x48"),
        ({"learning_rate": 0.0}, "`learning_rate` must be > 0, got 0"),
        ({"learning_rate": float("inf")}, "`learning_rate` must be > 0, got inf"),
        ({"learning_decay": 1.1}, r"`learning_decay` must be in \(0, 1\], got 1.1"),
        ({"weight_decay": -1.0}, "`weight_decay` must be >= 0, got -1"),
    ],
)
def test_settings_that_cannot_be(few, choices, message):
    with pytest.raises(ValueError, match=message):
        train(_start(few, **SMALL), few, **{"steps": 1} | choices)


def test_samples_that_do_not_fit_are_refused(few):
    start = _start(few, **SMALL)
    other = dataclasses.replace(few, metric="flip")
    with pytest.raises(ValueError, match="`samples` must have metric toy, got flip"):
        train(start, other, steps=1)
    with pytest.raises(ValueError, match="`samples` must have outputs"):
        evaluate(_start(few, outputs=("2x2",), **SMALL), few)
    finer = _start(few, **SMALL | {"region": 8})
    with pytest.raises(ValueError, match="`samples` must have 4x6 regions of 8 px"):
        evaluate(finer, few)
    names = ("reprojected_red", "seen", "roughness")
    with pytest.raises(ValueError, match="`samples` must have the channel roughness"):
        train(_start(few, channels=names, **SMALL), few, steps=1)


def test_a_loss_that_is_not_finite_is_an_error(few):
    start = _start(few, **SMALL)
    broken = eqx.tree_at(
        lambda n: n.blocks[0].bias, start, start.blocks[0].bias * np.nan
    )
    with pytest.raises(
        ValueError, match="must keep the loss finite, got nan at step 1"
    ):
        train(broken, few, steps=1, batch=2)
