"""`alsarr evaluate`: how well networks predict on viewpoints that they never saw."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TYPE_CHECKING

import typer

from camojab import _command as command

from . import _options, _scores
from ._capture_command import capture, PROCEDURAL, read_scene


if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ._viewpoint import RateMap
    from .capture import Scene
    from .network import MetricNetwork, Samples


_WRITTEN = ("scores.csv", "rate_maps.csv", "attribution.csv", "rate_maps.png")

# Viewpoints in a figure, and the rate whose error is drawn.
_DRAWN = 4
_DRAWN_RATE = "2x4"

_TITLES = {
    "rate_maps": "Pictures of the first viewpoint at the budget",
    "attribution": "What each input contributes, in per cent",
}
_FORMATS = _scores.FORMATS | {
    **{"flip_mean": ".4f", "cost_share": ".2%", "seen": ".1f", "unseen": ".1f"},
}


def evaluate(
    network: _options.Networks = None,
    scene: Annotated[
        str, typer.Option(help="procedural, or a .glb, .gltf or .obj file.")
    ] = PROCEDURAL,
    viewpoints: Annotated[
        int, typer.Option(min=2, help="Fresh viewpoints to judge by.")
    ] = 16,
    size: Annotated[
        str, typer.Option(help="Width and height of the pictures in pixels.")
    ] = "640x368",
    seed: Annotated[int, typer.Option(help="Of the viewpoints.")] = 7,
    scene_seed: Annotated[int, typer.Option(help="Of the procedural scene.")] = 0,
    budget: Annotated[
        float,
        typer.Option(help="Of the rate maps, as a share of full rate everywhere."),
    ] = 0.25,
    refresh_rate: Annotated[
        float, typer.Option(help="For CaMoJAB [Hz]: one frame is one viewpoint.")
    ] = 60.0,
    peak_luminance: Annotated[
        float, typer.Option(help="For CaMoJAB: of the display's white in cd/m2.")
    ] = 200.0,
    attribution: Annotated[
        bool, typer.Option(help="Also tell how much each input contributes.")
    ] = False,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.")
    ] = Path("eval"),
    processes: Annotated[
        int, typer.Option(min=1, help="How many viewpoints to render side by side.")
    ] = 1,
) -> None:
    """Capture fresh viewpoints, and compare what networks predict with what is there.

    Prints the columns of the paper's Table 2, and writes them with pictures of what was
    predicted beside what was measured, and of the rate maps that the network, the
    metric itself and CaMoJAB choose for the same budget.
    """
    from camojab._results import check_folder

    with command.usable():
        networks = _scores.networks(network)
    pictures = [f"{name}_predicted.png" for name in networks]
    check_folder(output, [*_WRITTEN, *pictures])
    folder = output / "views"
    capture(
        scene=scene,
        viewpoints=viewpoints,
        size=size,
        seed=seed,
        scene_seed=scene_seed,
        output=folder,
        processes=processes,
    )
    with command.usable(), command.stages() as progress:
        from .capture import views

        paths = views(folder)[:viewpoints]
        rows, shares = [], []
        for name, each in networks.items():
            samples = _scores.samples(each, paths, lambda *n, of=name: progress(of, *n))
            rows += [{"network": name} | row for row in _scores.rows(each, samples)]
            if attribution:
                shares += _shares(name, each, samples)
            _draw_predictions(output / f"{name}_predicted.png", each, samples, paths)
        display = {"refresh_rate": refresh_rate, "peak_luminance": peak_luminance}
        world = read_scene(scene, scene_seed)
        maps = _maps(networks, paths[0], world, budget=budget, **display)
        _draw_maps(output / "rate_maps.png", maps)
    _show(output, rows, shares, maps)
    built = f" {scene_seed}" if scene == PROCEDURAL else ""
    ppd = ", ".join(sorted({f"{each.ppd:g}" for each in networks.values()}))
    print(
        f"to quote: alsarr {command.release()}; {', '.join(networks)}; {viewpoints} "
        f"viewpoints of {Path(scene).name}{built}, seed {seed}, {size} px; {ppd} px/deg"
    )


def _shares(
    name: str, network: "MetricNetwork", samples: "Samples"
) -> list[dict[str, Any]]:
    from .network import attribute

    found = attribute(network, samples)
    columns = zip(found.channels, found.seen, found.unseen, strict=True)
    return [
        {"network": name, "channel": channel, "seen": seen, "unseen": unseen}
        for channel, seen, unseen in columns
    ]


def _draw_predictions(
    path: Path, network: "MetricNetwork", samples: "Samples", views: Sequence[Path]
) -> None:
    """Of the viewpoints of which most was seen before, and of which least was."""
    import jax.numpy as jnp
    import numpy as np

    from .capture import load_view
    from .network import predictions
    from .plotting import predicted_errors

    rate = _DRAWN_RATE if _DRAWN_RATE in network.outputs else network.outputs[0]
    output = network.outputs.index(rate)
    order = np.argsort(samples.seen.mean(axis=(1, 2))).tolist()
    half = min(_DRAWN, len(order)) // 2
    chosen = [*order[-half:][::-1], *order[:half]]
    shown = [load_view(views[i]) for i in chosen]
    predicted = predictions(network, samples.take(chosen))[:, output]
    target = jnp.asarray(samples.targets[chosen, output])
    measured = np.asarray(network.transform(target))
    figure = predicted_errors(
        [view.reference for view in shown],
        [view.seen for view in shown],
        list(measured),
        list(predicted),
        label=f"{network.metric} of {rate}, transformed [1]",
    )
    _save(path, figure)


def _maps(
    networks: Mapping[str, "MetricNetwork"],
    path: Path,
    scene: "Scene",
    *,
    budget: float,
    refresh_rate: float,
    peak_luminance: float,
) -> "dict[str, RateMap]":
    """Of one viewpoint: by each network, by what it predicts, and by CaMoJAB."""
    from ._rates import RATES
    from ._viewpoint import camojab_quality, measured, rate_map
    from .capture import load_view
    from .network import as_error
    from .oracle import CnnOracle, UniformOracle

    view = load_view(path)
    ppd = next(iter(networks.values())).ppd
    display = {"ppd": ppd, "refresh_rate": refresh_rate}
    display["peak_luminance"] = peak_luminance
    frame = view.frame(**display)
    qualities = {"uniform": UniformOracle().quality(frame, refresh_rate)}
    for name, network in networks.items():
        qualities[name] = CnnOracle(network, safe=False).quality(frame, refresh_rate)
        error = as_error(measured(view, network.metric, ppd=ppd), network.metric)
        qualities[f"{network.metric} measured"] = -error.reshape(len(RATES), -1).T
    qualities["CaMoJAB"] = camojab_quality(view, scene, **display)
    return {
        name: rate_map(view, quality, budget=budget, ppd=ppd)
        for name, quality in qualities.items()
    }


def _draw_maps(path: Path, maps: "Mapping[str, RateMap]") -> None:
    from .plotting import rate_maps

    figure = rate_maps(
        {name: each.rate for name, each in maps.items()},
        {name: each.picture for name, each in maps.items()},
        {name: each.flip for name, each in maps.items()},
        label="mean FLIP",
    )
    _save(path, figure)


def _save(path: Path, figure: "Figure") -> None:
    from camojab._files import replacing

    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _show(
    output: Path,
    rows: list[dict[str, Any]],
    shares: list[dict[str, Any]],
    maps: "Mapping[str, RateMap]",
) -> None:
    """The tables, as files and on the screen."""
    import pandas

    from camojab._files import write_text

    scores = pandas.DataFrame(rows)
    made = [
        {"oracle": name, "flip_mean": each.flip, "cost_share": each.cost}
        for name, each in maps.items()
    ]
    tables = {"scores": scores, "rate_maps": pandas.DataFrame(made)}
    if shares:
        tables["attribution"] = pandas.DataFrame(shares)
    for name, table in tables.items():
        write_text(output / f"{name}.csv", table.to_csv(index=False))
    overall = pandas.DataFrame([row for row in rows if row["output"] == "all"])
    overall = overall.drop(columns="output")
    command.print_table("Prediction, in transformed space", overall, _FORMATS)
    for name in list(tables)[1:]:
        command.print_table(_TITLES[name], tables[name], _FORMATS)
    pictures = [f"{name}_predicted.png" for name in scores["network"].unique()]
    files = [*(f"{name}.csv" for name in tables), *pictures, "rate_maps.png"]
    print(f"written: {', '.join(str(output / file) for file in files)}")
