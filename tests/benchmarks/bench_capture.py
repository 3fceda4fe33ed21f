"""What rendering a viewpoint costs, part by part.

    python tests/benchmarks/bench_capture.py [SCENE ...]

of hall, and of .glb, .gltf and .obj files; hall if none is named. Compilation is shown
apart from runs. Times are processor time of all threads, the least of several runs: on
a machine that others use as well it is what stays the same.
"""

import sys
import tempfile
import time
import zipfile
from pathlib import Path

import jax
import numpy as np

from alsarr import RATES
from alsarr.capture import (
    capture_view,
    coarse_invocations,
    hall,
    load_scene,
    load_view,
    save_view,
    View,
    ViewpointSampler,
)
from alsarr.capture._capture import _before, _buffers
from alsarr.capture._coarse import every_pixel
from alsarr.capture._render import BATCH, picture, shade, Stage
from alsarr.capture._visibility import visible_triangles


SIZE = 640, 368
FULL = (1, 1)


def row(name, seconds, more=""):
    print(f"{name:<34}{1e3 * seconds:>9.0f} ms  {more}")


def least(run, runs=5):
    """Least processor time of several runs, and what the last gave. [s]"""
    times, found = [], None
    for _ in range(runs):
        start = time.process_time()
        found = jax.block_until_ready(run())
        times.append(time.process_time() - start)
    return min(times), found


def show(name):
    start = time.process_time()
    scene = hall(0) if name == "hall" else load_scene(name)
    print(f"\n{scene.name}: {len(scene.triangle)} triangles, {SIZE[0]}x{SIZE[1]}")
    row("scene", time.process_time() - start)
    seconds, stage = least(lambda: Stage.of(scene), 1)
    row("tree of triangles (with first ray)", seconds)
    start = time.process_time()
    sampler = ViewpointSampler(scene, seed=0, aspect=SIZE[0] / SIZE[1])
    row("free space", time.process_time() - start)
    start = time.process_time()
    viewpoints = [sampler.draw(index) for index in range(3)]
    row("viewpoint", (time.process_time() - start) / 3)
    camera, previous = viewpoints[0]
    take = lambda viewpoint: capture_view(
        scene, *viewpoint, size=SIZE, tracer=stage.tracer
    )
    start = time.process_time()
    take(viewpoints[0])
    row("first view, with compilation", time.process_time() - start)
    whole = [least(lambda v=v: take(v), 3)[0] for v in viewpoints]
    row("view", float(np.mean(whole)), f"of {len(whole)}: mean")
    show_parts(stage, camera, previous)
    show_files(take(viewpoints[0]))


def show_parts(stage, camera, previous):
    seconds, triangle = least(
        lambda: visible_triangles(stage.tracer, camera, size=SIZE)
    )
    row("  visibility", seconds)
    plain, full, before = every_pixel(triangle), None, None
    for name, cell in zip(RATES.names, map(tuple, RATES.size.tolist()), strict=True):
        grouping, wanted = least(lambda c=cell: coarse_invocations(triangle, c))
        chosen = plain if cell == FULL else wanted
        seconds, shaded = least(
            lambda w=chosen, c=cell: shade(stage, camera, w, cell=c, size=SIZE)
        )
        tone, _ = least(lambda s=shaded, w=chosen: picture(s.light, w, 1.0))
        share = len(wanted) / len(plain)
        row(
            f"  shading at {name}",
            grouping + seconds + tone,
            f"{len(wanted)} samples ({share:.1%}), "
            f"grouping {1e3 * grouping:.0f}, tone {1e3 * tone:.0f}",
        )
        full = shaded
    seconds, before = least(lambda: _before(stage, previous, size=SIZE, batch=BATCH))
    row("  previous view", seconds)
    seconds, _ = least(
        lambda: _buffers(stage.scene, camera, full, plain, before, size=SIZE)
    )
    row("  G-buffer and reprojection", seconds)


def show_files(view):
    arrays = {name: getattr(view, name) for name in View.ARRAYS}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "view.npz"
        for name, write in (
            ("NumPy, not packed", lambda: np.savez(path, **arrays)),
            ("NumPy, packed", lambda: np.savez_compressed(path, **arrays)),
            ("save_view", lambda: save_view(path, view)),
        ):
            seconds, _ = least(write, 3)
            size = path.stat().st_size / 1e6
            row(f"  writing: {name}", seconds, f"{size:.1f} MB")
        with zipfile.ZipFile(path) as archive:
            largest = max(archive.infolist(), key=lambda entry: entry.compress_size)
        seconds, _ = least(lambda: load_view(path).images, 3)
        row(
            "  reading: load_view",
            seconds,
            f"most of it {largest.filename}, {largest.compress_size / 1e6:.1f} MB",
        )


def main(scenes):
    for name in scenes or ["hall"]:
        show(name)


if __name__ == "__main__":
    main(sys.argv[1:])
