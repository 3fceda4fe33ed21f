"""`alsarr train`, `evaluate` and `predict`, on a room that is captured in a moment."""

import csv
import dataclasses
import re

import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import Frame, RATES, save_frame
from alsarr._viewpoint import camojab_quality, measured, rate_map, shaded
from alsarr.capture import load_scene, load_view, save_view, views
from alsarr.cli import main
from alsarr.network import load_network
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


def test_a_viewpoint_is_drawn_with_its_units(captured):
    figure = view_buffers(load_view(views(captured)[0]))
    titles = [axis.get_title() for axis in figure.axes if axis.get_title()]
    assert len(titles) == 12
    assert {"depth [m]", "mip level [octaves]", "motion [px]"} < set(titles)


def test_a_map_shows_each_tile_as_it_was_captured(captured):
    view = load_view(views(captured)[0])
    rate = np.arange(12).reshape(3, 4) % len(RATES)
    picture = shaded(view, rate)
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
        (("train", captured, *OPTIONS, "-o", tmp_path), "ends in .npz"),
        (("train", tmp_path, *OPTIONS), "must be a folder with views"),
        (("train", captured, *OPTIONS[2:], "--ppd", 0), "`ppd` must be > 0"),
        (("train", captured, *OPTIONS, "--held-out", 9), "`held_out` must be"),
        (("train", captured, *OPTIONS, "--outputs", "1x1"), "coarse rates, got 1x1"),
        (("score", captured, *known, "-o", tmp_path), "ends in .csv"),
        (("score", captured, *known, "--held-out", 9), "`held_out` must be"),
    ):
        assert run(*arguments) == 1
        assert message in " ".join(capsys.readouterr().err.split())
    for option, value in (("--crop", "32"), ("--groups", "1,a"), ("--groups", "0")):
        assert run("train", captured, *OPTIONS, option, value) == 2
        assert f"'{option}': must be" in capsys.readouterr().err
