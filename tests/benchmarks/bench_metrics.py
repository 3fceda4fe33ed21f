"""What FLIP costs a megapixel, beside its authors' program.

    python tests/benchmarks/bench_metrics.py

Compilation is timed apart from runs, of which the median is shown; both programs run in
turn on the same pictures, and their largest disagreement is shown too.
"""

import os
import time

import flip_evaluator
import jax
import jax.numpy as jnp
import numpy as np

from alsarr.metrics import automatic_exposures, flip, hdr_flip, METRICS


PPD = 67.0206
SIZES = (("640x368", 368, 640), ("1920x1080", 1080, 1920))


def row(*cells):
    widths = (24, 14, 14, 16, 12, 12)
    print("".join(str(c).ljust(w) for c, w in zip(cells, widths, strict=False)))


def median(run, least=5):
    times = []
    for _ in range(least):
        start = time.perf_counter()
        jax.block_until_ready(run())
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def first(run):
    """How long the first run takes, which compiles."""
    jax.clear_caches()
    start = time.perf_counter()
    jax.block_until_ready(run())
    return time.perf_counter() - start


def pictures(height, width):
    random = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width] / 40
    waves = [np.sin(x * k + y) * np.cos(y * k - x) for k in (1, 2, 5)]
    reference = np.clip(0.5 + 0.4 * np.stack(waves, axis=-1), 0, 1)
    noise = random.normal(scale=0.05, size=reference.shape)
    test = np.clip(reference + noise, 0, 1)
    return reference.astype(np.float32), test.astype(np.float32)


def theirs(pair, kind):
    return flip_evaluator.evaluate(*pair, kind, True, False, False, {"ppd": PPD})


def show(name, megapixels, ours, peer):
    compiling = first(ours)
    # In turn, so that what else the machine does falls on both.
    other = median(lambda: peer()[1], least=2)
    took = median(ours)
    apart = np.abs(np.asarray(ours()) - peer()[0][..., 0]).max()
    row(
        name,
        f"{compiling:.2f}",
        f"{1e3 * took / megapixels:.1f}",
        f"{1e3 * other / megapixels:.1f}",
        f"{other / took:.1f}",
        f"{apart:.1e}",
    )


def alone(name, megapixels, run):
    compiling = first(run)
    row(name, f"{compiling:.2f}", f"{1e3 * median(run) / megapixels:.1f}")


def main():
    load = f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    print(f"jax {jax.__version__}, {jnp.result_type(float)}, {jax.devices()}, {load}")
    row("metric", "compile [s]", "ours [ms/Mpx]", "theirs [ms/Mpx]", "ratio", "apart")
    for name, height, width in SIZES:
        pair, area = pictures(height, width), height * width / 1e6
        show(
            f"flip {name}",
            area,
            lambda p=pair: flip(*p, ppd=PPD),
            lambda p=pair: theirs(p, "LDR"),
        )
    height, width = SIZES[0][1:]
    pair, area = pictures(height, width), height * width / 1e6
    light = [8 * picture**2 for picture in pair]
    show(
        f"hdr_flip, {len(automatic_exposures(light[0]))} exposures",
        area,
        lambda: hdr_flip(*light, ppd=PPD),
        lambda: theirs(light, "HDR"),
    )
    for name, metric in METRICS.items():
        alone(f"tiles of {name}", area, lambda of=metric: of(*pair, ppd=PPD))
    loss = lambda test: jnp.sum(flip(pair[0], test, ppd=PPD))
    alone("grad(flip)", area, lambda: jax.grad(loss)(pair[1]))
    merged = jax.jit(jax.grad(loss))
    alone("jit(grad(flip))", area, lambda: merged(pair[1]))


if __name__ == "__main__":
    main()
