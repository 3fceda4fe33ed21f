"""What choosing the rates of a frame costs, and how far each solver is from the best.

    python tests/benchmarks/bench_control.py [PART ...]

of gaps, time, batch and device; all if none is named. Compilation is timed apart from
runs, and of many runs the median is shown.
"""

import functools
import os
import resource
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy import optimize, sparse

from alsarr import Frame, procedural_frame, RATES
from alsarr.oracle import TableOracle
from alsarr.solve import dynamic_programme, greedy_jindal2021, hull, lagrangian
from alsarr.tables import distil, Eq31LogTravel, Form, sample, Scene
from camojab import datasets, Pooled, Spectrum


GOLDEN = Path(__file__).parents[1] / "golden" / "knapsack_scifi.npz"
# Picture, rows and columns of tiles, and what a frame may take. [ms]
SIZES = (
    ("1920x1080", 68, 120, 3),
    ("3840x2160", 135, 240, 12),
    ("7680x4320", 270, 480, 48),
)
FULL, SHARE, REFRESH_RATE, FRAMES = int(RATES.cost.max()), 0.25, 60.0, 120
FORM = Form(Eq31LogTravel())
HIGHS_LIMIT_S = 120
COST = RATES.cost.astype(np.float32)


def row(*cells):
    widths = (30, 11, 14, 14, 14, 14, 14)
    print("".join(str(c).ljust(w) for c, w in zip(cells, widths, strict=False)))


def ms(seconds):
    return f"{1e3 * seconds:.3g}"


def median(run, *, seconds=2.0, least=5, most=400):
    """Median time of a run, after one that is not counted. [s]"""
    jax.block_until_ready(run())
    times, end = [], time.perf_counter() + seconds
    while len(times) < least or (time.perf_counter() < end and len(times) < most):
        start = time.perf_counter()
        jax.block_until_ready(run())
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def compiled(function, *arguments):
    """The compiled function, and how long tracing and compiling took. [s]"""
    jax.clear_caches()
    start = time.perf_counter()
    ready = jax.jit(function).lower(*arguments).compile()
    return ready, time.perf_counter() - start


def percent(share):
    # Adding zero takes the sign from a rounded zero.
    return f"{round(100 * float(share), 6) + 0.0:.6f}"


def show_gaps():
    with np.load(GOLDEN) as stored, jax.enable_x64(True):
        quality, cost = jnp.asarray(stored["quality_jnd"]), stored["cost"]
        print(
            f"\nSciFi frame, {len(quality)} tiles: below the optimum, own bound above"
        )
        row("solver", "budget", "quality [JND]", "below [%]", "bound [%]", "run [ms]")
        for share, budget, best in zip(
            *(stored[k] for k in ("budget_fraction", "budget", "optimum_jnd")),
            strict=True,
        ):
            for solver in (greedy_jindal2021, lagrangian, hull, dynamic_programme):
                run = lambda s=solver, b=float(budget): s(quality, cost, b)
                found, took = run(), median(run, seconds=0.5, least=1, most=20)
                row(
                    solver.__name__,
                    f"{share:.0%}",
                    f"{float(found.quality):.5f}",
                    percent(1 - found.quality / best),
                    percent(found.gap / found.quality),
                    ms(took),
                )


@functools.cache
def frames():
    """Each size's drawn frame, and tables of the six built-in textures for them."""
    drawn = [
        procedural_frame(6, rows=rows, columns=columns, seed=2021)
        for _, rows, columns, _ in SIZES
    ]
    scene = Scene.of_frames(drawn, num_textures=6, refresh_rate=(30, 120))
    textures = {
        name: Spectrum.from_texture(jnp.asarray(image, float))
        for name, image in datasets.builtin_textures().items()
    }
    # Coarse pools will do where only time matters.
    of = sample(textures, scene, ppd=60.0, fidelity=Pooled(1000))
    return drawn, TableOracle(distil(of, FORM))


def judge(oracle, frame):
    return oracle.quality(frame, REFRESH_RATE)


def solve(quality, budget):
    return lagrangian(quality, COST, budget, throw=False)


def control(oracle, frame, budget):
    return solve(judge(oracle, frame), budget)


def budget_of(frame):
    return jnp.asarray(SHARE * FULL * frame.texture.size, float)


def show_time():
    drawn, oracle = frames()
    print(f"\nTables ({FORM.basis.name}) and lagrangian, medians [ms]")
    row("picture", "target", "both", "tables", "solve", "compile [s]", "ns a tile")
    for (name, _, _, target), frame in zip(SIZES, drawn, strict=True):
        budget = budget_of(frame)
        both, took = compiled(control, oracle, frame, budget)
        tables, _ = compiled(judge, oracle, frame)
        quality = tables(oracle, frame)
        alone, _ = compiled(solve, quality, budget)
        times = (
            median(lambda f=both, x=frame, b=budget: f(oracle, x, b)),
            median(lambda f=tables, x=frame: f(oracle, x)),
            median(lambda f=alone, q=quality, b=budget: f(q, b)),
        )
        per_tile = f"{1e9 * times[0] / frame.texture.size:.0f}"
        row(name, target, *map(ms, times), f"{took:.2f}", per_tile)
    _peers(np.asarray(judge(oracle, drawn[0])))


def _peers(quality):
    budget = SHARE * FULL * len(quality)
    asked = jnp.asarray(quality), jnp.asarray(budget, jnp.float32)
    ours, _ = compiled(solve, *asked)
    found = ours(*asked)
    gap = float(found.gap / jnp.abs(found.quality))
    print(f"\nOthers on the same {len(quality)} tiles, {SHARE:.0%}")
    row("solver", "run [ms]", "times ours", "target", "quality [JND]", "gap")
    took = median(lambda: ours(*asked))
    row("lagrangian", ms(took), 1, "", f"{float(found.quality):.4f}", f"{gap:.1e}")

    expected = greedy_jindal2021(quality, COST, budget).rate
    total = quality[np.arange(len(quality)), expected].sum(dtype=float)
    for function in (algorithm_1_in_numpy, algorithm_1_in_a_loop):
        assert np.array_equal(function(quality, COST, budget), expected)
        theirs = median(lambda f=function: f(quality, COST, budget))
        ratio = f"{theirs / took:.1f}"
        row(function.__name__, ms(theirs), ratio, ">= 5", f"{total:.4f}")
    _highs(quality, budget, gap, took)


def algorithm_1_in_a_loop(quality, cost, budget):
    """As printed: one sort of the ratios, and a loop over them in Python."""
    order = np.argsort(-(quality[:, 1:] / cost[1:]).ravel(), kind="stable")
    tiles, rates = np.divmod(order, quality.shape[1] - 1)
    rates += 1
    entries = (tiles, rates, quality[tiles, rates])
    best, chosen, cost = quality[:, 0].tolist(), [0] * len(quality), cost.tolist()
    left = budget - cost[0] * len(quality)
    for tile, rate, value in zip(*(x.tolist() for x in entries), strict=True):
        if left <= 0:
            break
        if value > best[tile]:
            after = left - cost[rate] + cost[chosen[tile]]
            if after < 0:
                break
            left, best[tile], chosen[tile] = after, value, rate
    return np.array(chosen)


def algorithm_1_in_numpy(quality, cost, budget):
    """Without any loop: what would be taken without a limit is sorted once.

    That does not depend on the other tiles, so the running cost of what would be taken,
    in the order of its ratios, tells where the budget ends.
    """
    ratio = quality[:, 1:] / cost[1:]
    order = np.argsort(-ratio, axis=1, kind="stable") + 1
    sorted_quality = np.take_along_axis(quality, order, axis=1)
    before = np.empty_like(sorted_quality)
    before[:, 0] = quality[:, 0]
    before[:, 1:] = sorted_quality[:, :-1]
    np.maximum.accumulate(before, axis=1, out=before)
    tile, step = np.nonzero(sorted_quality > before)
    rate = order[tile, step]
    # Taken steps of a tile follow one another.
    extra = cost[rate]
    first = np.flatnonzero(np.r_[True, tile[1:] != tile[:-1]])
    previous = np.r_[0, extra[:-1]]
    previous[first] = cost[0]
    extra = extra - previous
    visit = np.argsort(-ratio[tile, rate - 1], kind="stable")
    left = budget - cost[0] * len(quality)
    spent = np.cumsum(extra[visit], dtype=float)
    room = left - np.r_[0, spent[:-1]]
    stop = (room <= 0) | (spent > left)
    end = np.argmax(stop) if stop.any() else stop.size
    chosen = np.zeros(len(quality), int)
    # Of a tile's steps the last one that is written stays.
    chosen[tile[visit[:end]]] = rate[visit[:end]]
    return chosen


def _highs(quality, budget, gap, ours):
    """A mixed-integer solver that may stop at the same gap."""
    tiles, rates = quality.shape
    each = sparse.kron(sparse.eye(tiles), np.ones((1, rates)), format="csr")
    limits = [
        optimize.LinearConstraint(each, 1, 1),
        optimize.LinearConstraint(np.tile(COST, tiles)[None], -np.inf, budget),
    ]
    start = time.perf_counter()
    found = optimize.milp(
        -quality.ravel().astype(float),
        constraints=limits,
        integrality=np.ones(quality.size),
        bounds=optimize.Bounds(0, 1),
        options={"mip_rel_gap": gap, "time_limit": HIGHS_LIMIT_S},
    )
    took = time.perf_counter() - start
    ended = f"stopped after {HIGHS_LIMIT_S} s" if found.status == 1 else "done"
    total = "none" if found.x is None else f"{-found.fun:.4f}"
    reached = "" if found.x is None else f"{found.mip_gap:.1e}"
    ratio = f"{took / ours:.0f}"
    row(f"HiGHS, {ended}", ms(took), ratio, ">= 1000", total, reached)


def sequence(frame):
    """Frames of one size with other motion and light, stacked."""
    random = np.random.default_rng(0)
    scale = jnp.asarray(random.uniform(0.5, 1.5, (3, FRAMES, 1, 1)), jnp.float32)
    many = lambda x: jnp.broadcast_to(x, (FRAMES, *x.shape))
    return eqx.tree_at(
        lambda f: (f.velocity_x, f.velocity_y, f.luminance),
        jax.tree.map(many, frame),
        tuple(
            many(x) * factor
            for x, factor in zip(
                (frame.velocity_x, frame.velocity_y, frame.luminance),
                scale,
                strict=True,
            )
        ),
    )


def show_batch():
    drawn, oracle = frames()
    frame, budget = drawn[0], budget_of(drawn[0])
    stacked = sequence(frame)
    one, _ = compiled(control, oracle, frame, budget)
    single = [jax.tree.map(lambda x, i=i: x[i], stacked) for i in range(FRAMES)]
    print(f"\n{FRAMES} frames of {frame.texture.size} tiles, medians a frame")
    row("how", "run [ms]", "compile [s]", "plan [MB]", "process [MB]")
    looped = median(lambda: [one(oracle, f, budget) for f in single], least=3)
    row("one by one", ms(looped / FRAMES), "", _plan(one), _process())
    ways = {
        "lax.map": lambda o, f, b: jax.lax.map(lambda x: control(o, x, b), f),
        "vmapped": lambda o, f, b: jax.vmap(control, (None, 0, None))(o, f, b),
    }
    for name, way in ways.items():
        many, took = compiled(way, oracle, stacked, budget)
        whole = median(lambda f=many: f(oracle, stacked, budget), least=3)
        row(name, ms(whole / FRAMES), f"{took:.2f}", _plan(many), _process())


def _plan(program):
    """What XLA sets aside for arguments, results and in between. [MB]"""
    plan = program.memory_analysis()
    kinds = ("argument", "output", "temp")
    return f"{sum(getattr(plan, f'{k}_size_in_bytes') for k in kinds) / 1e6:.1f}"


def _process():
    """The most that this process has held so far. [MB]"""
    return f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f}"


def show_device():
    found = [d for d in jax.devices() if d.platform != "cpu"]
    if not found:
        print("\njax has no accelerator here")
        return
    drawn, oracle = frames()
    for device in found[:1]:
        print(f"\non {device.device_kind}, medians [ms]; buffers start in host memory")
        row("picture", "tables, solve", "solve", "frame in", "rates out")
        for (name, *_), frame in zip(SIZES, drawn, strict=True):
            _on_device(name, device, oracle, frame)


def _on_device(name, device, oracle, frame):
    host: Frame = jax.tree.map(np.asarray, frame)
    put = lambda x: jax.device_put(x, device)
    here, there = put(oracle), put(frame)
    budget = put(budget_of(frame))
    both, _ = compiled(control, here, there, budget)
    quality = jax.block_until_ready(judge(here, there))
    alone, _ = compiled(solve, quality, budget)
    chosen = [both(here, there, budget).rate]

    def fetch():
        # An array keeps the copy of its first fetch.
        return np.asarray(jnp.copy(chosen[0]))

    copied = median(lambda: jnp.copy(chosen[0]))
    row(
        name,
        ms(median(lambda: both(here, there, budget))),
        ms(median(lambda: alone(quality, budget))),
        ms(median(lambda: put(host))),
        ms(max(median(fetch) - copied, 0)),
    )


if __name__ == "__main__":
    asked = sys.argv[1:] or ["gaps", "time", "batch", "device"]
    load = f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    print(f"jax {jax.__version__}, {jnp.result_type(float)}, {jax.devices()}, {load}")
    # Everything but `device` is timed on the processor.
    with jax.default_device(jax.devices("cpu")[0]):
        for part in asked:
            globals()[f"show_{part}"]()
