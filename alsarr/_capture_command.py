"""`alsarr capture`: a folder of rendered viewpoints of a scene."""

import functools
import hashlib
import json
import shutil
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TYPE_CHECKING

import typer

from camojab import _command as command

from . import _options


if TYPE_CHECKING:
    from .capture import Camera, Scene, Tracer


RECORD = "capture.json"

# The scene that is built, not read from a file.
PROCEDURAL = "procedural"

_SCHEMA = "alsarr-capture/1"

# A folder goes on where it stopped only with the same of these.
_SAME = ("schema", "scene", "scene_seed", "sha256", "seed", "size", "fov_y")

# What the library calls the options.
_OPTIONS = {
    "`seed`": "`--seed`",
    "`size`": "`--size`",
    "`fov_y`": "`--fov-y`",
}


class _Job(NamedTuple):
    """What every process needs to know; all of it can be sent to one."""

    folder: Path
    scene: str
    scene_seed: int
    size: tuple[int, int]


_Viewpoint = tuple["Camera", "Camera"]


def capture(
    scene: Annotated[
        str,
        typer.Argument(
            help="procedural, a hall that is built from --scene-seed, or a .glb, .gltf "
            "or .obj file."
        ),
    ],
    viewpoints: Annotated[
        int, typer.Option(help="How many; a folder with fewer is added to.")
    ] = 200,
    size: Annotated[
        str, typer.Option(help="Width and height of the pictures in pixels.")
    ] = "640x368",
    seed: Annotated[int, typer.Option(help="Of the viewpoints.")] = 0,
    scene_seed: Annotated[int, typer.Option(help="Of the procedural scene.")] = 0,
    fov_y: Annotated[
        float, typer.Option(help="Vertical angle of view in degrees.")
    ] = 60.0,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.")
    ] = Path("capture"),
    processes: Annotated[
        int, typer.Option(help="How many viewpoints to render side by side.")
    ] = 1,
) -> None:
    """Render viewpoints of a scene at every shading rate, with their G-buffers.

    Each viewpoint is a file, written whole. What is in the folder already is kept, if
    it is of the same scene, seed and size; so an interrupted run is simply run again.
    Files that are damaged are rendered anew.
    """
    from camojab._results import check_folder

    shape = _options.size(size, "--size")
    for name, value in (("--viewpoints", viewpoints), ("--processes", processes)):
        if value < 1:
            raise command.Unusable(f"`{name}` must be >= 1, got {value}.")
    check_folder(output, [RECORD])
    job = _Job(output, scene, scene_seed, shape)
    with command.usable(_OPTIONS), command.stages() as progress:
        record = _record(job, viewpoints, seed, fov_y)
        _check_same(output, record)
        missing = _missing(output, viewpoints, progress)
        _check_disk(output, shape, len(missing))
        progress("scene", 0, 1)
        scene_read, _ = _staged(job)
        progress("scene", 1, 1)
        work = _drawn(scene_read, missing, job, seed, fov_y, progress)
        _write_record(output, record)
        for done, _ in enumerate(_rendered(job, work, processes), 1):
            progress("rendering", done, len(missing))
    _print_outcome(output, viewpoints, len(missing))


def read_scene(name: str, seed: int) -> "Scene":
    """The procedural scene of that seed, or that of a file."""
    from .capture import hall, load_scene

    return hall(seed) if name == PROCEDURAL else load_scene(name)


@functools.lru_cache(maxsize=1)
def _staged(job: _Job) -> "tuple[Scene, Tracer]":
    """The scene and its triangles for rays: once in every process."""
    import numpy as np

    from .capture import Tracer

    scene = read_scene(job.scene, job.scene_seed)
    vertex, triangle = np.asarray(scene.vertex), np.asarray(scene.triangle)
    return scene, Tracer(vertex, triangle)


def _drawn(
    scene: "Scene",
    numbers: list[int],
    job: _Job,
    seed: int,
    fov_y: float,
    progress: Callable[[str, int, int], None],
) -> list[tuple[int, _Viewpoint]]:
    """The viewpoints of these numbers; each depends on the seed and its number."""
    from .capture import ViewpointSampler

    if not numbers:
        return []
    aspect = job.size[0] / job.size[1]
    sampler = ViewpointSampler(scene, seed=seed, fov_y=fov_y, aspect=aspect)
    drawn = []
    for done, number in enumerate(numbers, 1):
        drawn.append((number, sampler.draw(number)))
        progress("viewpoints", done, len(numbers))
    return drawn


def _record(job: _Job, count: int, seed: int, fov_y: float) -> dict[str, Any]:
    """What the folder's views are of."""
    built = job.scene == PROCEDURAL
    if not built and not Path(job.scene).is_file():
        raise command.Unusable(
            f"`SCENE` must be {PROCEDURAL} or a .glb, .gltf or .obj file, got "
            f"{job.scene}."
        )
    return {
        "schema": _SCHEMA,
        "scene": PROCEDURAL if built else Path(job.scene).name,
        "scene_seed": job.scene_seed if built else None,
        "sha256": None if built else _digest(Path(job.scene)),
        "seed": seed,
        "size": list(job.size),
        "fov_y": fov_y,
        "viewpoints": count,
    }


def _digest(scene: Path) -> str:
    """Of a scene's file; of all digests, if it names other files."""
    from camojab._results import sha256

    from .capture._load import scene_files

    digests = [sha256(file) if file.is_file() else "" for file in scene_files(scene)]
    if len(digests) == 1:
        return digests[0]
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()


def _check_same(folder: Path, record: dict[str, Any]) -> None:
    """Fail for a folder of something else; its views would be taken for this one's."""
    from .capture import views

    path = folder / RECORD
    if not path.exists():
        if folder.is_dir() and any(folder.glob("view_*.npz")):
            first = views(folder)[0]
            raise command.Unusable(
                f"{folder}: must be a folder without views of another run, has "
                f"{first.name} but no {RECORD}."
            )
        return
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
        differing = [name for name in _SAME if there[name] != record[name]]
    except (ValueError, KeyError, TypeError) as error:
        raise command.Unusable(f"{path}: must be what this command writes.") from error
    if differing:
        raise command.Unusable(
            f"{folder}: must be a folder whose {differing[0]} is "
            f"{record[differing[0]]}, it is {there[differing[0]]}."
        )
    record["viewpoints"] = max(record["viewpoints"], there.get("viewpoints", 0))


def _write_record(folder: Path, record: dict[str, Any]) -> None:
    from importlib.metadata import version

    from camojab._files import write_text

    versions = {name: version(name) for name in ("jax", "numpy", "embreex")}
    whole = record | {"alsarr": command.release(), "versions": versions}
    write_text(folder / RECORD, json.dumps(whole, indent=1) + "\n")


def _missing(
    folder: Path, count: int, progress: Callable[[str, int, int], None]
) -> list[int]:
    """Numbers of the views that are not there, or cannot be read."""
    missing = []
    for index in range(count):
        if not _is_there(folder, index):
            missing.append(index)
        progress("from before", index + 1, count)
    return missing


def _is_there(folder: Path, index: int) -> bool:
    from .capture._view import load_view, view_path

    path = view_path(folder, index)
    if not path.is_file():
        return False
    try:
        load_view(path)
    except ValueError:
        return False
    return True


def _check_disk(folder: Path, size: tuple[int, int], count: int) -> None:
    """Say how much is going to be written, and fail if there is no room for it."""
    from .capture._view import most_bytes

    there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    need, free = count * most_bytes(size), shutil.disk_usage(there).free
    print(f"{folder}: {count} views to render, at most {_amount(need)}")
    if need > free:
        raise command.Unusable(
            f"{there}: must have {_amount(need)} of free disk space, has "
            f"{_amount(free)}."
        )


def _amount(count: int) -> str:
    return f"{count / 1e9:.2f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def _rendered(
    job: _Job, work: list[tuple[int, _Viewpoint]], processes: int
) -> Iterator[int]:
    """Render viewpoints, here or in other processes; gives each that is written."""
    if min(processes, len(work)) <= 1:
        for index, viewpoint in work:
            yield _one(job, index, viewpoint)
        return
    # JAX has threads, which a forked process would be without.
    pool = ProcessPoolExecutor(
        min(processes, len(work)),
        mp_context=get_context("spawn"),
        initializer=_leave_interrupts,
    )
    try:
        for done in as_completed([pool.submit(_one, job, *each) for each in work]):
            yield done.result()
    finally:
        # Interrupted, those under way are finished and the rest are not begun.
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_interrupts() -> None:
    """Ctrl-C reaches every process of a terminal; only the first acts upon it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _one(job: _Job, index: int, viewpoint: _Viewpoint) -> int:
    from .capture import capture_view, save_view
    from .capture._view import view_path

    scene, tracer = _staged(job)
    view = capture_view(scene, *viewpoint, size=job.size, tracer=tracer)
    save_view(view_path(job.folder, index), view)
    return index


def _print_outcome(folder: Path, count: int, rendered: int) -> None:
    from .capture._view import view_path

    size = sum(view_path(folder, i).stat().st_size for i in range(count))
    kept = f"{count - rendered} of them from before, " if rendered < count else ""
    print(f"{folder}: {count} views, {kept}{_amount(size)}")
