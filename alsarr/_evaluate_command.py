"""`alsarr evaluate`: how well networks predict on viewpoints that they never saw."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TYPE_CHECKING

import typer

from camojab import _command as command

from . import _options, _scores
from ._capture_command import capture, PROCEDURAL, read_scene


if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from ._viewpoint import RateMap
    from .capture import Scene
    from .network import MetricNetwork, Samples
    from .oracle import CnnOracle


_WRITTEN = ("scores.csv", "rate_maps.csv", "attribution.csv", "rate_maps.png")

# Viewpoints in a figure, and the rate whose error is drawn.
_DRAWN = 4
_DRAWN_RATE = "2x4"

# What the library calls the options.
_OPTIONS = {
    "`budget`": "`--budget`",
    "`refresh_rate`": "`--refresh-rate`",
    "`peak_luminance`": "`--peak-luminance`",
}

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
        typer.Option(
            help="Of the rate maps, as a share of full rate everywhere, from 0.0625 "
            "to 1."
        ),
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
    metric itself and CaMoJAB choose for the same budget. Networks of one resolution
    (ppd) can be compared, and of them those have a rate map that predict 1x2 and 2x1.
    """
    from camojab._results import check_folder

    with command.usable(_OPTIONS):
        _check_options(budget, refresh_rate, peak_luminance)
        networks = _scores.networks(network)
        ppd = _common_ppd(networks)
        oracles, left_out = _oracles(networks)
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
    with command.usable(_OPTIONS), command.stages() as progress:
        from .capture import views

        paths = views(folder)[:viewpoints]
        rows, shares = [], []
        for name, each in networks.items():
            samples = _scores.samples(each, paths, lambda *n, of=name: progress(of, *n))
            rows += [{"network": name} | row for row in _scores.rows(each, samples)]
            if attribution:
                shares += _shares(name, each, samples)
            _draw_predictions(output / f"{name}_predicted.png", each, samples, paths)
        tables = {"scores": _written(output, "scores", rows)}
        if attribution:
            tables["attribution"] = _written(output, "attribution", shares)
        display = {"refresh_rate": refresh_rate, "peak_luminance": peak_luminance}
        world = read_scene(scene, scene_seed)
        maps = _maps(oracles, paths[0], world, budget=budget, ppd=ppd, **display)
        tables["rate_maps"] = _written(output, "rate_maps", _map_rows(maps))
        _draw_maps(output / "rate_maps.png", maps)
    _show(tables)
    for line in left_out:
        print(line)
    files = [*(f"{name}.csv" for name in tables), *pictures, "rate_maps.png"]
    print(f"written: {', '.join(str(output / file) for file in files)}")
    built = f" {scene_seed}" if scene == PROCEDURAL else ""
    print(
        f"to quote: alsarr {command.release()}; {', '.join(networks)}; {viewpoints} "
        f"viewpoints of {Path(scene).name}{built}, seed {seed}, {size} px; {ppd:g} "
        "px/deg"
    )


def _check_options(budget: float, refresh_rate: float, peak_luminance: float) -> None:
    """Fail before the viewpoints are captured, not after."""
    from ._run import check_budget
    from .oracle._checks import checked_refresh_rate, positive

    check_budget(budget)
    checked_refresh_rate(refresh_rate)
    positive("peak_luminance", peak_luminance, "cd/m^2")


def _common_ppd(networks: Mapping[str, "MetricNetwork"]) -> float:
    """At which all were trained: pictures that are judged at two are not compared."""
    found = sorted({each.ppd for each in networks.values()})
    if len(found) > 1:
        raise ValueError(
            "`--network` must name networks of one ppd, whose rate maps can be "
            f"compared, got {', '.join(f'{ppd:g}' for ppd in found)} px/deg."
        )
    return found[0]


def _oracles(
    networks: Mapping[str, "MetricNetwork"],
) -> "tuple[dict[str, CnnOracle], list[str]]":
    """Of the networks that can make a rate map, and why others cannot."""
    from .oracle import CnnOracle

    oracles, left_out = {}, []
    for name, network in networks.items():
        try:
            oracles[name] = CnnOracle(network, safe=False)
        except ValueError as error:
            left_out.append(f"{name} is left out of the rate maps: {error}")
    return oracles, left_out


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
    oracles: "Mapping[str, CnnOracle]",
    path: Path,
    scene: "Scene",
    *,
    budget: float,
    ppd: float,
    refresh_rate: float,
    peak_luminance: float,
) -> "dict[str, RateMap]":
    """Of one viewpoint: by each network, by what it predicts, and by CaMoJAB."""
    from ._rates import RATES
    from ._viewpoint import camojab_quality, measured, rate_map
    from .capture import load_view
    from .network import as_error
    from .oracle import UniformOracle

    view = load_view(path)
    display = {"ppd": ppd, "refresh_rate": refresh_rate}
    display["peak_luminance"] = peak_luminance
    frame = view.frame(**display)
    qualities = {"uniform": UniformOracle().quality(frame, refresh_rate)}
    for name, oracle in oracles.items():
        qualities[name] = oracle.quality(frame, refresh_rate)
        metric = oracle.network.metric
        if f"{metric} measured" not in qualities:
            error = as_error(measured(view, metric, ppd=ppd), metric)
            qualities[f"{metric} measured"] = -error.reshape(len(RATES), -1).T
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


def _map_rows(maps: "Mapping[str, RateMap]") -> list[dict[str, Any]]:
    return [
        {"oracle": name, "flip_mean": each.flip, "cost_share": each.cost}
        for name, each in maps.items()
    ]


def _written(output: Path, name: str, rows: list[dict[str, Any]]) -> "pandas.DataFrame":
    """A table, once it is in its file."""
    import pandas

    from camojab._files import write_text

    table = pandas.DataFrame(rows)
    write_text(output / f"{name}.csv", table.to_csv(index=False))
    return table


def _show(tables: "Mapping[str, pandas.DataFrame]") -> None:
    overall = tables["scores"].query("output == 'all'").drop(columns="output")
    command.print_table("Prediction, in transformed space", overall, _FORMATS)
    for name in list(tables)[1:]:
        command.print_table(_TITLES[name], tables[name], _FORMATS)
