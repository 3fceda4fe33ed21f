"""What choosing both rates at once buys, and what steady maps cost.

    python tests/benchmarks/bench_sequences.py [joint] [changes]

- `joint`: the refresh rate from Eq. 24 and then the map (two stages) against the best
  of the maps at all refresh rates, on the sample frames and on sequences of them.
- `changes`: tiles that change their rate from frame to frame, and what it costs to
  keep them.

Tables are those of the main job on built-in data, or the published ones of the SciFi
frame; the moving picture is the published snapshot. Needs the published data.
"""

import sys

import equinox as eqx
import imageio.v3 as iio
import jax
import jax.numpy as jnp
import numpy as np

from alsarr import (
    Budget,
    Controller,
    every_rate,
    Frame,
    joint_refresh,
    mean_velocity,
    refresh_table,
)
from alsarr._inputs import builtin_inputs, jindal2021_inputs
from alsarr.oracle import TableOracle
from alsarr.tables import distil, Eq31LogTravel, Form, sample
from camojab import datasets, Display, luminance, Pooled, Spectrum


PPD, FRAMES = 60.0, 48
RATES = every_rate(120, 30)[::5]
VELOCITIES = np.arange(0, 61, 2.0)
BUDGETS = (0.0625, 0.125, 0.25)


def scenes():
    """Sample frames with their tables, by name."""
    drawn = builtin_inputs(ppd=PPD, refresh_rate=60.0)
    spectra = {k: Spectrum.from_texture(v) for k, v in drawn.textures.items()}
    tables = distil(sample(spectra, drawn.scene, ppd=PPD), Form(Eq31LogTravel()))
    published = jindal2021_inputs(ppd=PPD, refresh_rate=60.0, frame_luminance=50.0)
    return {
        "drawn frame": (drawn.frame, TableOracle(tables)),
        "SciFi frame": (published.frame, TableOracle(published.tables)),
    }


def sequence(frame, *, noise, seed=0):
    """A camera that turns ever faster and slower: the frame moves on by its columns.

    Velocities are those of the frame times 0 to 3. `noise`: relative, of velocity and
    luminance, anew in every frame.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(FRAMES)
    speed = 1.5 - 1.5 * np.cos(2 * np.pi * time / FRAMES)
    start = np.cumsum(speed).astype(int)

    def at(x, factor, spread):
        moved = np.stack([np.roll(np.asarray(x), -by, axis=1) for by in start])
        shake = np.exp(spread * rng.standard_normal(moved.shape))
        return jnp.asarray(moved * factor[:, None, None] * shake, float)

    same = np.ones(FRAMES)
    whole = np.stack([np.roll(np.asarray(frame.texture), -by, axis=1) for by in start])
    template = jax.tree.map(lambda x: jnp.stack([x] * FRAMES), frame)
    fields = ("texture", "mip_level", "velocity_x", "velocity_y", "luminance")
    values = (
        jnp.asarray(whole),
        at(frame.mip_level, same, 0.0),
        at(frame.velocity_x, speed, noise),
        at(frame.velocity_y, speed, noise),
        at(frame.luminance, same, noise),
    )
    return eqx.tree_at(lambda f: [getattr(f, n) for n in fields], template, values)


def one_of(frames: Frame, index: int) -> Frame:
    return jax.tree.map(lambda x: x[index], frames)


def picture():
    path = datasets.fetch("jindal2021/ALSaRR/sample_data/scene_snapshot.png")
    return Spectrum.from_texture(luminance(iio.imread(path)[..., :3], encoding="sRGB"))


def joint():
    print("\nRefresh rate in two stages (Eq. 24, then the map) or at once with the map")
    print("quality = moving picture - mean loss of the tiles [JND]")
    columns = f"{'':26}{'budget':>8}{'frames':>8}{'differ':>8}{'two stages':>12}"
    print(columns + f"{'at once':>10}{'gain':>8}{'largest':>9}{'Hz':>16}")
    display = Display(ppd=PPD, refresh_rate=120, luminance=50)
    shown = {"ppd": PPD, "luminance": 50, "fidelity": Pooled(5000)}
    grid = {"refresh_rates": RATES, "velocities": VELOCITIES}
    spectrum = picture()
    whole = joint_refresh(spectrum, **shown, **grid)
    for name, (frame, oracle) in scenes().items():
        rows, columns = frame.shape
        size = (16 * columns, 16 * rows)
        for kind, frames in (
            ("one frame", jax.tree.map(lambda x: x[None], frame)),
            ("sequence", sequence(frame, noise=0.0)),
        ):
            for budget in BUDGETS:
                pixels = budget * size[0] * size[1] * 120
                table = refresh_table(
                    spectrum,
                    pixels_per_second=pixels,
                    resolution_px=size,
                    **shown,
                    **grid,
                )
                found = [
                    Controller(display, oracle, Budget.share(budget), refresh=refresh)
                    for refresh in (table, whole)
                ]
                two, both = (controller.over(frames) for controller in found)
                moving = jax.vmap(lambda f: whole.at(mean_velocity(f)))(frames)
                at = np.searchsorted(RATES, np.asarray(two.refresh_rate))
                chosen = np.asarray(moving)[np.arange(len(at)), at]
                first = chosen - np.asarray(two.loss)
                best = np.asarray(both.worth).max(axis=1)
                gain = best - first
                differ = np.mean(np.asarray(two.refresh_rate != both.refresh_rate))
                hertz = " -> ".join(
                    f"{np.mean(np.asarray(d.refresh_rate)):.0f}" for d in (two, both)
                )
                print(
                    f"{name + ', ' + kind:26}{budget:8.2%}{len(at):8}{differ:8.0%}"
                    f"{first.mean():12.3f}{best.mean():10.3f}{gain.mean():8.3f}"
                    f"{gain.max():9.3f}{hertz:>16}"
                )


def changes():
    print("\nPrice of a tile's change, 60 Hz, 25 % of full rate, 5 % noise")
    columns = f"{'':14}{'price [JND]':>12}{'changed':>10}"
    print(columns + f"{'loss [JND a tile]':>19}{'more':>9}")
    display = Display(ppd=PPD, refresh_rate=60, luminance=50)
    for name, (frame, oracle) in scenes().items():
        frames, first = sequence(frame, noise=0.05), None
        for price in (0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0):
            found = Controller(
                display, oracle, Budget.share(0.25), rate_change=price
            ).over(frames)
            tiles = frame.texture.size
            changed = np.asarray(found.changed)[1:].mean() / tiles
            loss = float(np.asarray(found.loss).mean())
            first = loss if first is None else first
            print(f"{name:14}{price:12g}{changed:10.1%}{loss:19.4f}{loss - first:9.4f}")
    print("\nPrice of another refresh rate, chosen jointly, 12.5 % at 120 Hz")
    print(f"{'':14}{'price [JND]':>12}{'changes':>10}{'quality [JND]':>15}")
    whole = joint_refresh(
        picture(),
        ppd=PPD,
        luminance=50,
        fidelity=Pooled(5000),
        refresh_rates=RATES,
        velocities=VELOCITIES,
    )
    for name, (frame, oracle) in scenes().items():
        frames = sequence(frame, noise=0.05)
        for price in (0.0, 0.03, 0.1, 0.3, 1.0):
            found = Controller(
                display,
                oracle,
                Budget.share(0.125),
                refresh=whole,
                refresh_change=price,
            ).over(frames)
            rate = np.asarray(found.refresh_rate)
            moving = jax.vmap(lambda f: whole.at(mean_velocity(f)))(frames)
            at = np.searchsorted(RATES, rate)
            each = np.asarray(moving)[np.arange(len(at)), at] - np.asarray(found.loss)
            print(
                f"{name:14}{price:12g}{np.count_nonzero(np.diff(rate)):10}"
                f"{each.mean():15.4f}"
            )


if __name__ == "__main__":
    parts = {"joint": joint, "changes": changes}
    for part in sys.argv[1:] or parts:
        parts[part]()
