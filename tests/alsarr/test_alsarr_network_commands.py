"""`alsarr train`, `evaluate` and `predict`, on a room that is captured in a moment."""

import csv
import dataclasses
import re
import shutil
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import _evaluate_command, _viewpoint, Frame, RATES, save_frame
from alsarr._viewpoint import camojab_quality, measured, rate_map
from alsarr.capture import load_scene, load_view, save_view, views
from alsarr.cli import main
from alsarr.network import (
    ClampedTransform,
    initial_network,
    load_network,
    save_network,
)
from alsarr.oracle import CnnOracle
from alsarr.plotting import view_buffers
from toy_room import room


SIZE = ("--size", "64x40")


def run(*arguments):
    return main([str(x) for x in arguments])


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "room.obj"
    path.write_text(room())
    return path


@pytest.fixture(scope="module")
def captured(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("captured") / "views"
    assert run("capture", scene, "--viewpoints", 4, *SIZE, "-o", folder) == 0
    return folder


OPTIONS = ("--ppd", 20, "--held-out", 1, "--batch", 2, "--crop", "32x32", "--every", 2)


@pytest.fixture(scope="module")
def trained(captured, tmp_path_factory):
    path = tmp_path_factory.mktemp("trained") / "small.npz"
    assert run("train", captured, *OPTIONS, "--steps", 4, "-o", path) == 0
    return path


def test_a_network_that_says_what_it_is_of(trained):
    network = load_network(trained)
    assert (network.metric, network.ppd) == ("flip", 20.0)
    assert network.outputs == ("1x2", "2x1", "2x4", "4x2")
    assert float(network.safety_offset) > 0
    assert sorted(p.name for p in trained.parent.iterdir()) == [
        "small.checkpoint.npz",
        "small.npz",
    ]


def test_training_goes_on_from_its_checkpoint(captured, trained, tmp_path, capsys):
    path = tmp_path / "small.npz"
    for steps in (2, 4):
        assert run("train", captured, *OPTIONS, "--steps", steps, "-o", path) == 0
    assert "of 4, safety offset" in capsys.readouterr().out
    assert path.read_bytes() == trained.read_bytes()


@pytest.fixture(scope="module")
def evaluated(scene, trained, tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluated") / "eval"
    assert (
        run(
            *("evaluate", "--network", trained, "--scene", scene, "--viewpoints", 2),
            *("--seed", 7, *SIZE, "--attribution", "-o", folder),
        )
        == 0
    )
    return folder


@pytest.fixture(scope="module")
def networks(tmp_path_factory):
    """Files of untrained networks by what is special about each."""
    folder = tmp_path_factory.mktemp("networks")
    files = {}
    for name, settings in {
        "second": {},
        "square": {"outputs": ("1x2", "2x2")},
        "fine": {"ppd": 40.0},
        "lpips": {"metric": "lpips"},
        "small": {"region": 8},
        "foreign": {"channels": ("seen", "colour"), "groups": (1, 1, 1, 1, 1)},
        "psnr": {"metric": "psnr", "transform": ClampedTransform(-0.015, 1.0)},
    }.items():
        default = {"metric": "flip", "ppd": 20.0, "transform": ClampedTransform(2.0)}
        files[name] = folder / f"{name}.npz"
        save_network(files[name], initial_network(0, **default | settings))
    return files


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_what_an_evaluation_writes(evaluated):
    assert sorted(p.name for p in evaluated.iterdir()) == [
        *("attribution.csv", "rate_maps.csv", "rate_maps.png", "scores.csv"),
        *("small_predicted.png", "views"),
    ]
    for path in evaluated.glob("*.png"):
        assert path.read_bytes()[:4] == b"\x89PNG"
    scores = rows(evaluated / "scores.csv")
    assert len(scores) == 5 * 3 and {row["tiles"] for row in scores} == {
        *("all", "seen", "unseen")
    }
    for column in ("seen", "unseen"):
        shares = [
            float(r[column] or "nan") for r in rows(evaluated / "attribution.csv")
        ]
        assert np.isnan(shares).all() or np.isclose(sum(shares), 100)


def test_scores_are_those_of_the_tiles(evaluated, trained):
    network = load_network(trained)
    target, predicted = [], []
    for path in views(evaluated / "views"):
        view = load_view(path)
        error = measured(view, "flip", ppd=20.0)
        chosen = [RATES.names.index(name) for name in network.outputs]
        target.append(np.asarray(network.transform(error[np.array(chosen)])))
        x = np.stack(list(view.channels(network.channels).values()))
        predicted.append(np.asarray(network(jnp.asarray(x))))
    apart = np.abs(np.array(predicted) - np.array(target))
    overall = rows(evaluated / "scores.csv")[0]
    assert (overall["output"], overall["tiles"]) == ("all", "all")
    np.testing.assert_allclose(float(overall["mae"]), apart.mean(), rtol=1e-4)
    np.testing.assert_allclose(float(overall["sigma"]), apart.std(), rtol=1e-4)


def test_scores_scene_by_scene(captured, trained, tmp_path, capsys):
    known = ("--network", trained)
    out, other = tmp_path / "scores.csv", tmp_path / "views"
    other.mkdir()
    for path in views(captured)[:2]:
        elsewhere = dataclasses.replace(load_view(path), scene="elsewhere")
        save_view(other / path.name, elsewhere)
    assert run("score", captured, other, *known, "-o", out) == 0
    printed = capsys.readouterr().out
    assert re.search(r"small +elsewhere +2 ", printed), printed
    scored = rows(out)
    assert len(scored) == 3 * 5 * 3
    assert {row["scene"] for row in scored} == {"all", "elsewhere", "room"}
    apart = [row for row in scored if row["output"] == row["tiles"] == "all"]
    whole, *parts = (float(row["mae"]) * int(row["count"]) for row in apart)
    np.testing.assert_allclose(whole, sum(parts), rtol=1e-6)

    # What training held out is judged by the same numbers that it printed.
    again = tmp_path / "small.npz"
    assert run("train", captured, *OPTIONS, "--steps", 4, "-o", again) == 0
    told = capsys.readouterr().out.splitlines()[2].split()
    assert run("score", captured, "--network", again, "--held-out", 1, "-o", out) == 0
    held_out = rows(out)[0]
    assert {row["scene"] for row in rows(out)} == {"room"}
    assert int(told[2]) == int(held_out["count"])
    np.testing.assert_allclose(float(told[4]), float(held_out["mae"]), atol=6e-5)


def test_rate_maps_keep_to_the_budget(evaluated):
    maps = rows(evaluated / "rate_maps.csv")
    assert [row["oracle"] for row in maps] == [
        *("uniform", "small", "flip measured", "CaMoJAB")
    ]
    for row in maps:
        assert 1 / 16 <= float(row["cost_share"]) <= 0.25 + 1e-6
        assert 0 <= float(row["flip_mean"]) < 1
    assert len({row["flip_mean"] for row in maps}) > 1


def again(evaluated, scene, folder, *more):
    """The same evaluation, of views that are there already."""
    shutil.copytree(evaluated / "views", folder / "views", dirs_exist_ok=True)
    same = ("--scene", scene, "--viewpoints", 2, "--seed", 7, *SIZE, "-o", folder)
    return run("evaluate", *same, *more)


def test_maps_are_of_the_networks_that_can_make_one(
    evaluated, scene, trained, networks, tmp_path, capsys, monkeypatch
):
    found, real = [], _viewpoint.measured

    def counted(view, metric, *, ppd):
        found.append((metric, ppd))
        return real(view, metric, ppd=ppd)

    monkeypatch.setattr(_viewpoint, "measured", counted)
    three = (trained, networks["second"], networks["square"])
    options = [x for path in three for x in ("--network", path)]
    assert again(evaluated, scene, tmp_path, *options) == 0
    maps = rows(tmp_path / "rate_maps.csv")
    assert [row["oracle"] for row in maps] == [
        *("uniform", "small", "flip measured", "second", "CaMoJAB")
    ]
    assert found == [("flip", 20.0)]
    assert {row["network"] for row in rows(tmp_path / "scores.csv")} == {
        *("small", "second", "square")
    }
    told = capsys.readouterr().out
    assert (
        "square is left out of the rate maps: `network` must predict 1x2 and 2x1, got "
        "1x2, 2x2.\n" in told
    )


def test_scores_are_there_before_the_maps(
    evaluated, scene, trained, tmp_path, capsys, monkeypatch
):
    def fail(*arguments, **settings):
        raise ValueError("no maps")

    monkeypatch.setattr(_evaluate_command, "_maps", fail)
    more = ("--network", trained, "--attribution")
    assert again(evaluated, scene, tmp_path, *more) == 1
    assert "alsarr: no maps" in capsys.readouterr().err
    for name in ("scores.csv", "attribution.csv"):
        assert (tmp_path / name).read_bytes() == (evaluated / name).read_bytes()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--budget", 0.01), "`--budget` must be at least 0.0625, the cost of 4x4"),
        (("--budget", 2), "`--budget` must be in (0, 1], got 2."),
        (("--budget", "nan"), "`--budget` must be in (0, 1], got nan."),
        (("--refresh-rate", 0), "`--refresh-rate` must be > 0 Hz and finite, got 0."),
        (
            ("--peak-luminance", "inf"),
            "`--peak-luminance` must be finite and > 0 cd/m^2, got inf.",
        ),
        (
            ("--network", "fine"),
            "`--network` must name networks of one ppd, whose rate maps can be "
            "compared, got 20, 40 px/deg.",
        ),
        (
            ("--network", "lpips"),
            "`--network` must predict one of flip, jnflip, psnr, jnyang, yang, got "
            "lpips in lpips.",
        ),
        (
            ("--network", "small"),
            "`--network` must predict tiles of 16 px, got 8 px in small.",
        ),
        (("--network", "foreign"), "got colour in foreign."),
    ],
)
def test_what_cannot_be_evaluated_is_said_before_the_work(
    scene, networks, tmp_path, capsys, more, message
):
    folder, (option, value) = tmp_path / "eval", more
    asked = ("--scene", scene, "--viewpoints", 2, *SIZE, "-o", folder)
    asked += (option, networks.get(value, value), "--network", networks["second"])
    assert run("evaluate", *asked) == 1
    assert message in " ".join(capsys.readouterr().err.split())
    assert not folder.exists()


def test_a_viewpoint_is_drawn_with_its_units(captured):
    figure = view_buffers(load_view(views(captured)[0]))
    titles = [axis.get_title() for axis in figure.axes if axis.get_title()]
    assert len(titles) == 12
    assert {"depth [m]", "mip level [octaves]", "motion [px]"} < set(titles)


def test_a_map_shows_each_tile_as_it_was_captured(captured):
    view = load_view(views(captured)[0])
    rate = np.arange(12).reshape(3, 4) % len(RATES)
    picture = view.shaded(rate)
    for row, column in np.ndindex(3, 4):
        tile = np.s_[16 * row : 16 * row + 16, 16 * column : 16 * column + 16]
        np.testing.assert_array_equal(
            picture[tile], view.images[rate[row, column]][tile]
        )


def test_measured_errors_buy_a_better_picture_than_their_opposite(captured):
    view = load_view(views(captured)[0])
    error = measured(view, "flip", ppd=20.0)
    np.testing.assert_array_equal(error[-1], np.zeros((3, 4)))
    tiles = error.reshape(len(RATES), -1).T
    good, bad = (
        rate_map(view, quality, budget=0.3, ppd=20.0) for quality in (-tiles, tiles)
    )
    assert good.flip < bad.flip and good.cost <= 0.3
    for budget in (0.05, 1.5):
        with pytest.raises(ValueError, match="`budget` must be"):
            rate_map(view, -tiles, budget=budget, ppd=20.0)


def test_camojab_judges_a_captured_viewpoint(captured, scene):
    world, view = load_scene(scene), load_view(views(captured)[0])
    display = {"ppd": 20.0, "refresh_rate": 60.0, "peak_luminance": 200.0}
    quality = np.asarray(camojab_quality(view, world, **display))
    assert quality.shape == (12, 7) and np.isfinite(quality).all()


def test_predicted_errors_and_rates(captured, trained, tmp_path, capsys):
    view, out = views(captured)[0], tmp_path / "predicted.npz"
    more = ("--network", trained, "-o", out)
    assert run("predict", view, *more, "--budget", 0.5) == 0
    assert "FLIP of 12 tiles at 7 rates" in capsys.readouterr().out
    with np.load(out) as stored:
        error, rate = stored["error"], stored["rate"]
    frame = load_view(view).frame(ppd=60, refresh_rate=60, peak_luminance=100)
    oracle = CnnOracle(load_network(trained))
    expected = -np.asarray(oracle.quality(frame, 60.0)).reshape(3, 4, 7)
    np.testing.assert_allclose(error, expected, rtol=1e-5, atol=1e-6)
    assert RATES.cost[rate].sum() <= 0.5 * 256 * rate.size

    save_frame(tmp_path / "frame.npz", frame)
    limit = float(np.median(error[..., 0]))
    framed = (tmp_path / "frame.npz", *more, "--threshold", limit)
    for backend in ("jax", "onnxruntime"):
        assert run("predict", *framed, "--backend", backend) == 0
        with np.load(out) as stored:
            np.testing.assert_allclose(stored["error"], error, rtol=1e-4, atol=1e-5)
            chosen = np.asarray(oracle.rate(frame, 60.0, threshold=limit))
            np.testing.assert_array_equal(stored["rate"].ravel(), chosen)


def test_errors_of_psnr_are_roots_of_mean_square_errors(
    captured, networks, tmp_path, capsys
):
    view, out = views(captured)[0], tmp_path / "predicted.npz"
    assert run("predict", view, "--network", networks["psnr"], "-o", out) == 0
    assert "RMSE of 12 tiles at 7 rates" in capsys.readouterr().out
    network = load_network(networks["psnr"])
    x = np.stack(list(load_view(view).channels(network.channels).values()))
    decibels = eqx.filter_jit(network.predict)(jnp.asarray(x))
    with np.load(out) as stored:
        for name, values in zip(network.outputs, decibels, strict=True):
            found = stored["error"][..., RATES.names.index(name)]
            np.testing.assert_allclose(found, 10 ** (-np.asarray(values) / 20), 1e-4)
    assert run("predict", "--help") == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "for PSNR, of which the root of the mean square error is taken" in told


def test_what_cannot_be_done_is_said(captured, trained, tmp_path, capsys):
    plain = Frame(
        texture=np.zeros((2, 2), int),
        **{"mip_level": 0.0, "velocity_x": 0.0, "velocity_y": 0.0, "luminance": 1.0},
    )
    save_frame(tmp_path / "plain.npz", plain)
    (tmp_path / "damaged.npz").write_bytes(b"PK\x03\x04 and no more")
    known = ("--network", trained)
    for arguments, message in (
        (("predict", tmp_path / "plain.npz", *known), "`frame.channels` must have"),
        (("predict", tmp_path / "damaged.npz", *known), "is no NPZ file"),
        (("predict", tmp_path / "none.npz", *known), "No such file"),
        (("predict", views(captured)[0], *known, "-o", "x.png"), "ends in .npz"),
        (
            ("predict", views(captured)[0], *known, "--budget", 0.01),
            "`--budget` must be at least 0.0625, the cost of 4x4 everywhere, got 0.01.",
        ),
        (
            ("predict", views(captured)[0], *known, "--budget", 2),
            "`--budget` must be in (0, 1], got 2.",
        ),
        (("train", captured, *OPTIONS, "-o", tmp_path), "ends in .npz"),
        (("train", tmp_path, *OPTIONS), "must be a folder with views"),
        (("train", captured, *OPTIONS[2:], "--ppd", 0), "`--ppd` must be > 0"),
        (("train", captured, *OPTIONS, "--held-out", 9), "`--held-out` must be"),
        (("score", captured, *known, "-o", tmp_path), "ends in .csv"),
        (("score", captured, *known, "--held-out", 9), "`held_out` must be"),
    ):
        assert run(*arguments) == 1
        assert message in " ".join(capsys.readouterr().err.split())
    for option, value in (("--crop", "32"), ("--groups", "1,a"), ("--groups", "0")):
        assert run("train", captured, *OPTIONS, option, value) == 2
        assert f"'{option}': must be" in capsys.readouterr().err


@pytest.mark.parametrize(
    "choices, message",
    [
        (("--crop", "24x32"), "`--crop` must be positive multiples of 16 px, got"),
        (("--groups", "3,1,1"), "`--groups[0]` must divide 4 and 16 channels, got 3."),
        (("--groups", "1"), "the number of `--groups` must be > 0, and > 1 where"),
        (("--outputs", "1x1"), "`--outputs` must be some of 4x4,"),
        (("--channels", "seen,seen"), "`--channels` must be names, each once, got"),
        (("--learning-rate", 0), "`--learning-rate` must be > 0, got 0."),
        (("--learning-decay", 2), "`--learning-decay` must be in (0, 1], got 2."),
    ],
)
def test_wrong_settings_are_found_before_the_metric(
    captured, tmp_path, capsys, monkeypatch, choices, message
):
    monkeypatch.setattr("alsarr.network.load_samples", None)
    path = tmp_path / "small.npz"
    assert run("train", captured, *OPTIONS, *choices, "-o", path) == 1
    assert message in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_what_views_say_of_settings_has_the_names_of_options(
    captured, tmp_path, capsys
):
    path = tmp_path / "small.npz"
    for choices, message in (
        (("--channels", "seen,mood"), "`--channels` must be of reprojected_red,"),
        (("--crop", "640x48"), "`--crop` must be at most 64x48 px, got 640x48."),
    ):
        assert run("train", captured, *OPTIONS, *choices, "-o", path) == 1
        assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("metric", ["psnr", "jnflip", "jnyang"])
def test_the_logistic_transform_is_for_errors_up_to_one(captured, capsys, metric):
    choices = ("--metric", metric, "--transform", "logistic")
    assert run("train", captured, *OPTIONS, *choices) == 2
    message = f"'--transform': must be clamped with --metric {metric}, got logistic."
    assert message in " ".join(capsys.readouterr().err.split())


def test_a_missing_extra_is_found_before_the_metric(captured, capsys, monkeypatch):
    monkeypatch.setattr("alsarr.network.load_samples", None)
    monkeypatch.setitem(sys.modules, "optax", None)
    assert run("train", captured, *OPTIONS) == 1
    message = "`alsarr[train]` is not installed: training needs its optax."
    assert message in capsys.readouterr().err


def test_a_black_place_leaves_the_targets_of_a_weber_metric(captured, tmp_path):
    folder, path = tmp_path / "views", tmp_path / "small.npz"
    shutil.copytree(captured, folder)
    made = []
    for place in (0, 1):
        view = load_view(views(folder)[0])
        view.images[-1, 16 * place : 16 * place + 4, :4] = 0
        save_view(views(folder)[0], view)
        more = ("--metric", "jnyang", "--steps", 1, "-o", path)
        assert run("train", folder, *OPTIONS, *more) == 0
        made.append(float(load_network(path).transform.factor))
        path.with_suffix(".checkpoint.npz").unlink()
    # Of one black block and of two; the mean of the rest is about 1.
    np.testing.assert_allclose(*made, rtol=0.1)
    assert 0.01 < made[0] < 100
