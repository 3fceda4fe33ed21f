"""`alsarr capture`: what it writes, and that it goes on where it was stopped."""

import json
import shutil
import sys
from collections import namedtuple

import numpy as np
import pytest
import typer

from alsarr import _capture_command
from alsarr.capture import load_view, views
from camojab import _command
from toy_room import room


# The command computes in single precision whatever the lane.
pytestmark = pytest.mark.float64

APP = typer.Typer(add_completion=False)
APP.command()(_capture_command.capture)


def run(*arguments):
    return _command.run(APP, "alsarr", [str(x) for x in arguments])


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "room.obj"
    path.write_text(room())
    return path


def options(folder, *more):
    return ["--size", "48x32", "-o", folder, *more]


@pytest.fixture(scope="module")
def captured(scene, tmp_path_factory):
    """A folder with three views that one process rendered."""
    folder = tmp_path_factory.mktemp("captured") / "views"
    assert run(scene, "--viewpoints", 3, *options(folder)) == 0
    return folder


def copy(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "copy")


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_a_folder_of_views_and_of_what_they_are(captured, scene):
    assert sorted(contents(captured)) == [
        *("capture.json", "view_00000.npz", "view_00001.npz", "view_00002.npz")
    ]
    record = json.loads((captured / "capture.json").read_text())
    assert record["scene"] == "room.obj" and record["size"] == [48, 32]
    assert record["seed"] == 0 and record["viewpoints"] == 3
    assert set(record["versions"]) == {"jax", "numpy", "embreex"}
    for path in views(captured):
        view = load_view(path)
        assert view.images.shape == (7, 32, 48, 3)
        assert view.images.std() > 0 and view.seen.any()
        assert (np.diff(view.invocations[[0, 3, 6]]) > 0).all()


def test_what_is_there_is_kept_and_what_is_missing_is_made_anew(
    captured, scene, tmp_path, capsys
):
    folder, before = copy(captured, tmp_path), contents(captured)
    (folder / "view_00001.npz").unlink()
    (folder / "view_00002.npz").write_bytes(before["view_00002.npz"][:1000])
    kept = (folder / "view_00000.npz").stat().st_mtime_ns
    assert run(scene, "--viewpoints", 3, *options(folder)) == 0
    assert contents(folder) == before
    assert (folder / "view_00000.npz").stat().st_mtime_ns == kept
    told = capsys.readouterr().out.splitlines()
    assert "2 views to render, at most 0.2 MB" in told[0]
    assert "3 views, 1 of them from before" in told[1]


@pytest.mark.parametrize("place", [0.2, 0.5, 0.8])
def test_a_view_with_a_flipped_bit_is_rendered_anew(captured, scene, tmp_path, place):
    folder, before = copy(captured, tmp_path), contents(captured)
    damaged = bytearray(before["view_00001.npz"])
    damaged[int(place * len(damaged))] ^= 16
    (folder / "view_00001.npz").write_bytes(damaged)
    with pytest.raises(ValueError, match=r"view_00001\.npz: "):
        load_view(folder / "view_00001.npz")
    assert run(scene, "--viewpoints", 3, *options(folder)) == 0
    assert contents(folder) == before


def test_two_processes_write_what_one_writes(captured, scene, tmp_path):
    folder = tmp_path / "views"
    assert run(scene, "--viewpoints", 3, "--processes", 2, *options(folder)) == 0
    assert contents(folder) == contents(captured)


@pytest.mark.parametrize(
    "more, message",
    [
        (["--seed", 1], "must be a folder whose seed is 1, it is 0."),
        (["--fov-y", 50], "must be a folder whose fov_y is 50.0, it is 60.0."),
        (["--size", "32x32"], "whose size is [32, 32], it is [48, 32]."),
    ],
)
def test_a_folder_of_something_else_is_refused(
    captured, scene, tmp_path, capsys, more, message
):
    folder = copy(captured, tmp_path)
    assert run(scene, "--viewpoints", 3, *options(folder), *more) == 1
    assert message in capsys.readouterr().err
    assert contents(folder) == contents(captured)


def test_another_scene_of_the_same_name_is_refused(captured, tmp_path, capsys):
    other = tmp_path / "room.obj"
    other.write_text(room().replace("v 4 ", "v 5 "))
    assert run(other, "--viewpoints", 3, *options(captured)) == 1
    assert "must be a folder whose sha256 is" in capsys.readouterr().err


def test_a_scene_whose_other_files_changed_is_refused(tmp_path, capsys):
    path, folder = tmp_path / "room.obj", tmp_path / "views"
    path.write_text("mtllib room.mtl\nusemtl wall\n" + room())
    arguments = (path, "--viewpoints", 1, *options(folder))
    for colour, status in (("1 0 0", 0), ("1 0 0", 0), ("0 1 0", 1)):
        (tmp_path / "room.mtl").write_text(f"newmtl wall\nKd {colour}\n")
        assert run(*arguments) == status
    assert "must be a folder whose sha256 is" in capsys.readouterr().err
    (tmp_path / "room.mtl").unlink()
    assert run(*arguments) == 1


def test_views_without_a_record_and_broken_records_are_refused(
    captured, scene, tmp_path, capsys
):
    folder = copy(captured, tmp_path)
    (folder / "capture.json").write_text("[]")
    assert run(scene, *options(folder)) == 1
    assert "capture.json: must be what this command writes." in capsys.readouterr().err
    (folder / "capture.json").unlink()
    assert run(scene, *options(folder)) == 1
    assert "has view_00000.npz but no capture.json." in capsys.readouterr().err


def test_a_disk_with_less_room_is_refused(scene, tmp_path, capsys, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(0, 0, 1_000_000))
    folder = tmp_path / "views"
    assert run(scene, "--viewpoints", 50, *options(folder)) == 1
    assert "of free disk space, has 1.0 MB" in capsys.readouterr().err
    assert not folder.exists()


def test_an_interrupted_run_leaves_whole_views(
    captured, scene, tmp_path, capsys, monkeypatch
):
    """Interrupted while the second view is written."""
    folder, before = tmp_path / "views", contents(captured)
    real, made = _capture_command._one, []

    def interrupted(job, index, viewpoint):
        if made:
            raise KeyboardInterrupt
        made.append(real(job, index, viewpoint))
        return made[-1]

    with monkeypatch.context() as patch:
        patch.setattr(_capture_command, "_one", interrupted)
        assert run(scene, "--viewpoints", 3, *options(folder)) == 130
    assert contents(folder) == {
        name: before[name] for name in ("capture.json", "view_00000.npz")
    }
    assert run(scene, "--viewpoints", 3, *options(folder)) == 0
    assert contents(folder) == before


def test_without_the_extra_it_says_what_to_install(
    scene, tmp_path, capsys, monkeypatch
):
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    assert run(scene, *options(tmp_path / "views")) == 1
    assert "`alsarr[capture]` is not installed" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, status, message",
    [
        (
            ["nowhere.obj"],
            1,
            "`SCENE` must be procedural or a .glb, .gltf or .obj file",
        ),
        (["procedural", "--size", "48"], 2, "must be a width and a height >= 1 px"),
        (["procedural", "--size", "0x4"], 2, "got 0x4"),
        (["procedural", "--viewpoints", "0"], 1, "`--viewpoints` must be >= 1, got 0."),
        (["procedural", "--processes", "0"], 1, "`--processes` must be >= 1, got 0."),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path, capsys, arguments, status, message):
    folder = tmp_path / "views"
    assert run(*arguments, "-o", folder) == status
    assert message in " ".join(capsys.readouterr().err.split())
    assert not folder.exists()
