"""What holds for the command line of alsarr as a whole."""

from importlib.metadata import version

import jax
import pytest

from alsarr.cli import main


def test_the_line_for_a_bug_report(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"alsarr {version('alsarr')}\n"
    for argv in (["--version", "--verbose"], ["--verbose", "--version"]):
        assert main(argv) == 0
        (line,) = capsys.readouterr().out.splitlines()
        assert line.startswith(f"alsarr {version('alsarr')}, python ")
        assert f"jax {jax.__version__}, " in line and ", device " in line


@pytest.mark.parametrize("argv", [["--verbose"], ["--verbose", "run"], ["shade"]])
def test_a_wrong_line_is_one_line(capsys, argv):
    assert main(argv) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("alsarr: ") and line.endswith("See 'alsarr --help'.")


def test_every_command_has_help(capsys):
    assert main(["--help"]) == 0
    listed = capsys.readouterr().out
    commands = ("run", "tables", "solve", "refresh", "preview", "compare", "export")
    for command in (*commands, "capture", "train", "score", "evaluate", "explore"):
        assert command in listed
        assert main([command, "--help"]) == 0
        assert "Usage" in capsys.readouterr().out
