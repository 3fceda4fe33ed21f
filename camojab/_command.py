"""What the command lines share; importing it is quick."""

import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TYPE_CHECKING

import typer

from ._extras import MissingExtra


if TYPE_CHECKING:
    import pandas


# Problems that are printed before the rest is only counted.
SHOWN = 10


class Study(NamedTuple):
    """The files of one's own experiment."""

    votes: Path
    conditions: Path
    textures: Path | None
    encoding: str | None


Verbose = Annotated[
    bool,
    # Eager, or its value would not be known yet when the version is printed.
    typer.Option(
        "--verbose",
        is_eager=True,
        help="With --version: the line to paste in a bug report.",
    ),
]


class Unusable(Exception):
    """Data that cannot be used: one line a problem."""

    def __init__(self, *problems: str):
        super().__init__(*problems)
        self.problems = problems


def run(app: typer.Typer, program: str, argv: Sequence[str] | None) -> int:
    """Run the command line `argv`, or that of the process.

    **Returns:** 0 done, 1 the data cannot be used (`OSError` or `Unusable`), 2 the
    command line is wrong, 130 interrupted. The reason goes to the error stream, one
    line a problem.

    **Raises:** any other exception as it is, so that a defect keeps its traceback.
    """
    command = typer.main.get_command(app)
    args = None if argv is None else list(argv)
    try:
        status = command.main(args, prog_name=program, standalone_mode=False)
    except typer.Abort:
        return 130
    except (OSError, Unusable) as error:
        return _fail(program, _problems(error), 1)
    except Exception as error:
        # The class of typer's own errors is another one in each of its versions.
        if not hasattr(error, "format_message"):
            raise
        return _fail(program, [_usage(program, error)], 2)
    return int(status or 0)


def release() -> str:
    """The version of the distribution that both packages belong to."""
    return version("alsarr")


def print_version(program: str, asked: bool, verbose: bool) -> bool:
    """What `--version` does, given whether it was asked for; as it is otherwise."""
    if asked:
        print(environment(program) if verbose else f"{program} {release()}")
        raise typer.Exit()
    return asked


def check_verbose(verbose: bool) -> None:
    """Fail where `--verbose` stands alone."""
    if verbose:
        raise typer.BadParameter("goes with --version.", param_hint="'--verbose'")


def environment(program: str) -> str:
    """One line for a bug report: versions, platform and what JAX computes with."""
    import jax
    import jax.numpy as jnp

    packages = ("numpy", "jax", "equinox", "optimistix")
    device = jax.devices()[0]
    x64 = jnp.result_type(float) == jnp.float64
    parts = [
        f"{program} {release()}",
        f"python {platform.python_version()}",
        *(f"{name} {version(name)}" for name in packages),
        platform.platform(),
        f"x64 {'on' if x64 else 'off'} by default",
        f"device {device.platform} ({device.device_kind})",
    ]
    return ", ".join(parts)


def precision(bits: str) -> AbstractContextManager[Any]:
    """Within it JAX computes with so many bits, "32" or "64"."""
    import jax

    return jax.enable_x64(bits == "64")


@contextmanager
def usable(options: Mapping[str, str] | None = None) -> Iterator[None]:
    """What the library says of data and extras, as what the command line says of them.

    `options` are the command's names for what the library calls otherwise.
    """
    try:
        yield
    except MissingExtra as error:
        raise Unusable(str(error)) from error
    except ValueError as error:
        message = str(error)
        for name, option in (options or {}).items():
            message = message.replace(name, option)
        raise Unusable(*message.splitlines()) from error


@contextmanager
def stages() -> Iterator[Callable[[str, int, int], None]]:
    """A bar for each stage of the work, if the error stream is a terminal.

    What it gives is called with a stage's name, the steps done and their number.
    """
    from rich.console import Console
    from rich.progress import Progress

    silent = not sys.stderr.isatty()
    with Progress(console=Console(stderr=True), transient=True, disable=silent) as bars:
        tasks = {}

        def progress(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield progress


def print_table(
    title: str, frame: "pandas.DataFrame", formats: Mapping[str, str] | None = None
) -> None:
    """A table below its title, as `camojab._page.table` has it in a page."""
    from ._page import cells, numeric

    columns = []
    for heading, column in cells(frame, formats).items():
        width = max(map(len, [heading, *column]))
        align = str.rjust if numeric(column) else str.ljust
        columns.append([align(cell, width) for cell in [heading, *column]])
    print(f"{title}\n")
    for row in zip(*columns, strict=True):
        print("  ".join(row).rstrip())
    print()


def _problems(error: Exception) -> list[str]:
    if isinstance(error, Unusable):
        more = len(error.problems) - SHOWN
        rest = [f"{more} more problem{'s' if more > 1 else ''}."] if more > 0 else []
        return [*error.problems[:SHOWN], *rest]
    if isinstance(error, OSError) and error.filename is not None:
        return [f"{error.filename}: {error.strerror}."]
    return [str(error)]


def _usage(program: str, error: Any) -> str:
    context = getattr(error, "ctx", None)
    path = context.command_path if context else program
    return f"{error.format_message()} See '{path} --help'."


def _fail(program: str, problems: Sequence[str], status: int) -> int:
    for problem in problems:
        print(f"{program}: {' '.join(problem.split())}", file=sys.stderr)
    return status
