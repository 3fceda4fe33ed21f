"""`alsarr tables`: what it writes and prints, alone, interrupted and with others."""

import os
import re
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from alsarr import Frame
from alsarr._frame import save_frame
from alsarr.cli import main
from alsarr.tables import load_tables


# The command computes in single precision whatever the lane.
pytestmark = pytest.mark.float64

PROGRAM = "import sys; from alsarr.cli import main; sys.exit(main())"
# Enough for the accuracy of a table; the time limits are for a deadlock.
QUICK = ["--cells", "400"]
LIMIT = 300


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Three textures, the last of them flat, and a frame that shows two."""
    folder = tmp_path_factory.mktemp("given")
    random = np.random.default_rng(0)
    (folder / "textures").mkdir()
    images = {
        "a": random.random((64, 64)),
        "b": np.kron(random.random((16, 16)), np.ones((8, 8))),
        "c": np.full((512, 512), 0.5),
        "d": random.random((8, 8)),
    }
    for name, image in images.items():
        np.save(folder / "textures" / f"{name}.npy", image)
    frame = Frame(
        texture=np.array([[0, 1], [2, 1]]),
        mip_level=np.array([[0.0, 1.0], [0.0, 0.0]]),
        velocity_x=np.array([[0.0, 10.0], [2.0, 5.0]]),
        velocity_y=np.zeros((2, 2)),
        luminance=np.full((2, 2), 50.0),
    )
    save_frame(folder / "frame.npz", frame)
    return folder


def arguments(given, output, *more):
    options = ["--textures", given / "textures", "--frames", given / "frame.npz"]
    return [str(x) for x in ["tables", *options, "-o", output, *QUICK, *more]]


@pytest.fixture(scope="module")
def alone(given):
    """The file that one process with one device writes."""
    path = given / "alone.json"
    assert main(arguments(given, path)) == 0
    return path


def start(arguments, **environment):
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finish(process):
    try:
        output, _ = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 0, output
    return output


def test_only_what_the_frame_shows_is_distilled(given, alone):
    tables = load_tables(alone)
    assert tables.texture_names == ("a", "b", "c", "d")
    np.testing.assert_array_equal(tables.mip_levels, [0, 1])
    np.testing.assert_array_equal(
        tables.occurs, [[True, False], [True, True], [True, False], [False, False]]
    )
    np.testing.assert_array_equal(tables.domain.velocity, [0, 10])
    np.testing.assert_allclose(tables.domain.luminance, [50, 50], rtol=1e-6)
    np.testing.assert_array_equal(tables.domain.refresh_rate, [30, 120])
    assert [p.name for p in given.glob(".*.samples")] == []


def test_what_was_left_out_and_the_saving_are_printed(given, capsys):
    tolerant = arguments(given, given / "tolerant.json", "--tolerance", "2")
    assert main(tolerant) == 0
    printed = capsys.readouterr().out
    assert "4 of 48 pairs of texture and mip level; left out: a 1-11, b 2-11" in printed
    tables = load_tables(given / "tolerant.json")
    # The flat texture takes one number.
    assert list(np.asarray(tables.constant)) == [False, False, False, True]
    assert f"{tables.count} coefficients, " in printed
    assert "; textures that are one constant: 1\n" in printed
    assert "tolerance of 2 JND: is met\n" in printed
    assert tables.meets and tables.largest_error <= 2


def test_a_tolerance_that_nothing_meets_is_said(given, capsys):
    strict = arguments(given, given / "strict.npz", "--tolerance", "1e-6")
    assert main([*strict, "--form", "eq31"]) == 0
    assert "is met by no form; this comes nearest" in capsys.readouterr().out
    assert load_tables(given / "strict.npz").meets is False


def test_show_prints_the_certificate(alone, capsys):
    assert main(["tables", "show", str(alone)]) == 0
    printed = capsys.readouterr().out
    largest = float(load_tables(alone).largest_error)
    assert f"1032 held-out conditions: largest {largest:.3g} JND" in printed
    assert "velocity 0 to 10 deg/s, refresh rate 30 to 120 Hz" in printed
    assert re.search(r"^b +2 levels", printed, re.MULTILINE)
    assert not re.search(r"^d ", printed, re.MULTILINE)


def test_several_devices_write_the_same_bytes(given, alone):
    path = given / "devices.json"
    flag = "--xla_force_host_platform_device_count=3"
    finish(start(arguments(given, path), XLA_FLAGS=flag))
    assert path.read_bytes() == alone.read_bytes()


def test_two_processes_write_the_same_bytes(given, alone):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    path = given / "processes.json"
    shared = ["--coordinator", f"127.0.0.1:{port}", "--processes", "2", "--process"]
    both = [start(arguments(given, path, *shared, i)) for i in (0, 1)]
    first, second = map(finish, both)
    assert path.read_bytes() == alone.read_bytes()
    # One writes, and says so.
    assert "4 of 48 pairs" in first and "4 of 48 pairs" not in second
    assert not path.with_name(".processes.json.samples").exists()


def test_an_interrupted_run_goes_on_and_writes_the_same_bytes(given, alone):
    path = given / "interrupted.json"
    done = path.with_name(".interrupted.json.samples")
    # On a busy machine a run may be over before what it keeps is noticed.
    for _ in range(5):
        process = start(arguments(given, path))
        deadline = time.monotonic() + LIMIT
        while not list(done.glob("0*.npz")) and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT)
        if process.returncode:
            break
        path.unlink()
    assert process.returncode == 130 and not path.exists()
    kept = {p: p.stat().st_mtime_ns for p in done.glob("0*.npz")}
    assert kept
    finish(start(arguments(given, path)))
    assert path.read_bytes() == alone.read_bytes()
    assert not done.exists()


@pytest.mark.parametrize(
    "change, message",
    [
        (["-o", "tables.txt"], "tables.txt: must be a file .* ends in .json or .npz"),
        (["--textures", "nowhere"], "`--textures` must be a folder, builtin or"),
        (["--tolerance", "-1"], "`tolerance_jnd` must be > 0 JND, got -1"),
        (["--rates", "3x3"], "must be separable or of 4x4,.*, got 3x3"),
        (["--rates", "2x2"], "`rates` must be .* with 1x1, or 4, 2, 1, got 2x2"),
        (["--processes", "2"], "`--processes` must go with --coordinator, got 2"),
        (["--process", "1"], "`--process` must be from 0 to 0, got 1"),
        (["--ppd", "0"], "`ppd` must be finite and > 0 px/deg, got 0"),
        (["--refresh-rate", "60", "30"], "`refresh_rate` must be lowest first"),
        (["--encoding", "cinema"], "'--encoding'"),
        (["--constraint", "gain", "--absolute"], "`constraint` must be monotone"),
        (["--frames", "nowhere.npz"], "nowhere.npz: No such file"),
    ],
)
def test_what_is_wrong_is_one_line(
    given, tmp_path, monkeypatch, capsys, change, message
):
    monkeypatch.chdir(tmp_path)
    given_arguments = arguments(given, tmp_path / "tables.json", *change)
    assert main(given_arguments) in (1, 2)
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and re.search(message, error), error
    assert not list(tmp_path.glob("tables.*"))


def test_the_options_that_are_needed_are_named(capsys):
    assert main(["tables", "-o", "tables.json"]) == 2
    assert "'--textures': is needed" in capsys.readouterr().err
    assert main(["tables", "--textures", "builtin"]) == 2
    assert "'--output': is needed" in capsys.readouterr().err
