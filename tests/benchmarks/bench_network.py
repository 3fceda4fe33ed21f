"""What the network costs, beside other libraries with the same weights.

    python tests/benchmarks/bench_network.py [PART ...]

of inference, oracle and training; all if none is named. Compilation is timed apart from
runs. Pictures are 1920x1080: that our side pads them to whole tiles is timed, and
others are given them padded. onnxruntime has the same options alone as in the oracle.
All contenders of a part take turns, round by round, so that whatever else the machine
does falls on each of them; the median and the least of their runs are shown, and the
processor's time, of all threads, waiting ones included. PyTorch takes part where it is
installed.
"""

import importlib.util
import os
import sys
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import onnxruntime

from alsarr import Frame
from alsarr.network import ClampedTransform, initial_network
from alsarr.network._fast import infer
from alsarr.network._onnx_run import session
from alsarr.network._train import _optimiser, _Rates, _State, _step, _weights
from alsarr.oracle._cnn import CnnOracle


HEIGHT, WIDTH = 1080, 1920
CROP, BATCH = (368, 640), 4
THREADS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
TORCH = importlib.util.find_spec("torch") is not None
LEARNING, DECAY, WEIGHT = 1e-3, 1.0, 1e-6


def row(*cells):
    widths = (34, 12, 12, 12, 12, 14)
    print("".join(str(c).ljust(w) for c, w in zip(cells, widths, strict=False)))


def ms(seconds):
    return f"{1e3 * seconds:.3g}"


def rounds(contenders, count=15):
    """Each contender is (name, run, seconds to compile or None, largest difference)."""
    spent, draw = {name: [] for name, *_ in contenders}, np.random.default_rng(4)
    for _ in range(count):
        # Who comes after whom matters: what one leaves in the caches the next removes.
        for turn in draw.permutation(len(contenders)):
            name, run, *_ = contenders[turn]
            start, began = time.perf_counter(), time.process_time()
            jax.block_until_ready(run())
            busy = time.process_time() - began
            spent[name].append((time.perf_counter() - start, busy))
    row("", "median [ms]", "least [ms]", "busy [ms]", "compile [s]", "difference")
    for name, _, compiled, difference in contenders:
        wall, busy = np.array(spent[name]).T
        at_once = "" if compiled is None else f"{compiled:.2f}"
        far = "" if difference is None else f"{difference:.1e}"
        median = ms(np.median(wall)), ms(wall.min()), ms(np.median(busy))
        row(name, *median, at_once, far)


def compiled(function, *args):
    """The function for such arguments, and what compiling took. [s]"""
    start = time.perf_counter()
    run = jax.jit(function).lower(*args).compile()
    return run, time.perf_counter() - start


def network():
    """Untrained, with statistics as if it were not."""
    made = initial_network(0, metric="flip", ppd=60.0, transform=ClampedTransform(2.0))
    draw = np.random.default_rng(1)
    of = lambda x: jnp.asarray(draw.uniform(0.1, 0.4, x.shape).astype(np.float32))
    where = lambda n: [v for b in n.blocks for v in (b.shift, b.mean, b.variance)]
    return eqx.tree_at(where, made, [of(x) for x in where(made)])


def picture():
    """Masked by what was seen, as others are to be given it."""
    x = np.random.default_rng(2).random((4, HEIGHT, WIDTH), np.float32)
    x[1] = x[1] > 0.3
    x[0] *= x[1]
    return jnp.asarray(x)


def plain_runtime(net, x):
    """onnxruntime alone, given whole tiles: its graph drops those that are cut."""
    runtime, values = session(net, THREADS), np.asarray(net.prepared(x))[None]
    return lambda: runtime.run(None, {"input": values})[0]


def torch_network(net, last):
    """The same layers and weights as a PyTorch module."""
    import torch

    layers = []
    for block in net.blocks:
        outs, ins = block.weight.shape[:2]
        convolution = torch.nn.Conv2d(
            ins * block.groups, outs, 3, padding=1, groups=block.groups
        )
        normalisation = torch.nn.BatchNorm2d(outs)
        pairs = (
            (convolution.weight, block.weight),
            (convolution.bias, block.bias),
            (normalisation.weight, block.scale),
            (normalisation.bias, block.shift),
            (normalisation.running_mean, block.mean),
            (normalisation.running_var, block.variance),
        )
        with torch.no_grad():
            for to, values in pairs:
                to.copy_(torch.from_numpy(np.array(values)))
        layers += [convolution, torch.nn.ReLU(), normalisation]
        layers += [torch.nn.MaxPool2d(block.pool)] if block.pool > 1 else []
    made = torch.nn.Sequential(*layers, torch.nn.Sigmoid())
    return made.to(memory_format=torch.channels_last) if last else made


def torch_inference(net, x, expected):
    import torch

    torch.set_num_threads(THREADS)
    found = []
    for last in (False, True):
        made = torch_network(net, last).eval()
        values = torch.from_numpy(np.array(net.prepared(x)))[None]
        if last:
            values = values.contiguous(memory_format=torch.channels_last)

        def run(made=made, values=values):
            with torch.inference_mode():
                return made(values)

        far = np.abs(run()[0].numpy() - expected).max()
        found.append((f"PyTorch{', channels last' if last else ''}", run, None, far))
    return found


def show_inference():
    net, x = network(), picture()
    weights, static = eqx.partition(net, eqx.is_array)
    whole = lambda w: eqx.combine(w, static)
    plain, plain_s = compiled(lambda w, x: whole(w)(x), weights, x)
    fast, fast_s = compiled(lambda w, x: infer(whole(w), x), weights, x)
    expected = np.asarray(plain(weights, x))
    of_runtime = plain_runtime(net, x)
    contenders = [
        ("onnxruntime", of_runtime, None, abs(of_runtime()[0] - expected).max()),
        ("JAX, layer by layer", lambda: plain(weights, x), plain_s, 0.0),
        (
            "JAX, in strips",
            lambda: fast(weights, x),
            fast_s,
            abs(np.asarray(fast(weights, x)) - expected).max(),
        ),
    ]
    contenders += torch_inference(net, x, expected) if TORCH else []
    print(f"\nInference of {WIDTH}x{HEIGHT}, {THREADS} threads")
    rounds(contenders)


def from_channels(net, x):
    """onnxruntime, and what anybody has to do before: stack, mask and pad, by NumPy."""
    made, channels = session(net, THREADS), [np.asarray(channel) for channel in x]

    def run():
        pictures = np.stack(channels)
        pictures[0] *= pictures[1]
        below = [(0, 0), (0, -HEIGHT % net.region), (0, -WIDTH % net.region)]
        padded = np.pad(pictures, below, mode="edge")
        return made.run(None, {"input": padded[None]})[0]

    return run


def show_oracle():
    net, x = network(), picture()
    frame = Frame(
        texture=np.zeros((-(-HEIGHT // 16), WIDTH // 16), int),
        mip_level=0.0,
        velocity_x=0.0,
        velocity_y=0.0,
        luminance=50.0,
        channels=dict(zip(net.channels, x, strict=True)),
    )
    contenders, first = (
        [
            ("onnxruntime alone", plain_runtime(net, x), None, None),
            ("the same from channels", from_channels(net, x), None, None),
        ],
        None,
    )
    for backend in ("jax", "onnxruntime"):
        threads = THREADS if backend == "onnxruntime" else None
        oracle = CnnOracle(net, backend=backend, threads=threads)
        run = lambda oracle=oracle: oracle.quality(frame, 60.0)
        start = time.perf_counter()
        found = np.asarray(run())
        took = time.perf_counter() - start
        first = found if first is None else first
        far = abs(found - first).max()
        contenders.append((f"oracle by {backend}", run, took, far))
    print(f"\nOracle, {WIDTH}x{HEIGHT}; the first call for compiling")
    rounds(contenders)


def torch_training(net, x, target):
    import torch

    torch.set_num_threads(THREADS)
    found = []
    for last in (False, True):
        made = torch_network(net, last).train()
        optimiser = torch.optim.RMSprop(
            made.parameters(), lr=LEARNING, weight_decay=WEIGHT
        )
        values, wanted = (torch.from_numpy(np.array(v)) for v in (x, target))
        if last:
            values = values.contiguous(memory_format=torch.channels_last)

        def run(made=made, optimiser=optimiser, values=values, wanted=wanted):
            optimiser.zero_grad()
            loss = (torch.clamp(2 * wanted, 0, 1) - made(values)).abs().mean()
            loss.backward()
            optimiser.step()
            return loss.detach()

        run()
        found.append((f"PyTorch{', channels last' if last else ''}", run, None, None))
    return found


def show_training():
    net, draw = network(), np.random.default_rng(3)
    height, width = CROP
    x = jnp.asarray(draw.random((BATCH, 4, height, width), np.float32))
    tiles = (BATCH, 4, height // 16, width // 16)
    target = jnp.asarray(draw.uniform(0, 0.5, tiles).astype(np.float32))
    rates = _Rates(LEARNING, DECAY, WEIGHT)
    optimiser = _optimiser(rates).init(_weights(net))
    state = _State(net, optimiser, jnp.zeros((), jnp.int32))
    start = time.perf_counter()
    jax.block_until_ready(_step(state, x, target, rates)[1])
    took = time.perf_counter() - start
    run = lambda: _step(state, x, target, rates)[1]
    contenders = [("JAX", run, took, None)]
    contenders += torch_training(net, x, target) if TORCH else []
    print(
        f"\nTraining step of {BATCH} x {width}x{height}; the first call for compiling"
    )
    rounds(contenders, 5)


PARTS = {
    "inference": show_inference,
    "oracle": show_oracle,
    "training": show_training,
}


def main():
    named = sys.argv[1:] or [*PARTS]
    unknown = [name for name in named if name not in PARTS]
    if unknown:
        sys.exit(f"PART must be some of {', '.join(PARTS)}, got {', '.join(unknown)}.")
    load = os.getloadavg()[0]
    print(f"JAX {jax.__version__}, onnxruntime {onnxruntime.__version__}, load {load}")
    for name in named:
        PARTS[name]()


if __name__ == "__main__":
    main()
