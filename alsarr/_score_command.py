"""`alsarr score`: how well networks predict captured viewpoints, scene by scene."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from camojab import _command as command

from . import _options, _scores


if TYPE_CHECKING:
    from .network import Samples


def score(
    captures: _options.Captures,
    network: _options.Networks = None,
    held_out: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Only as many views of each scene: those that alsarr train held out, "
            "given the same folders and --seed.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of what was held out.")] = 0,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The CSV file to write, whole.")
    ] = Path("scores.csv"),
) -> None:
    """Compare what networks predict with what is there, scene by scene.

    Prints the columns of the paper's Table 2 over all views, about their common mean,
    and over those of each scene; the file has them for every rate.
    """
    if output.suffix.lower() != ".csv" or output.is_dir():
        raise command.Unusable(f"{output}: must be a file to write that ends in .csv.")
    with command.usable(), command.stages() as progress:
        import pandas

        from camojab._files import write_text

        from .capture import views

        paths = [path for folder in captures for path in views(folder)]
        scored, printed = [], []
        for name, each in _scores.networks(network).items():
            judged = _scores.samples(each, paths, lambda *n, of=name: progress(of, *n))
            if held_out is not None:
                judged = judged.split(held_out, seed=seed)[1]
            for scene, part in _by_scene(judged).items():
                place = {"network": name, "scene": scene}
                found = _scores.rows(each, part)
                scored += [place | row for row in found]
                counted = place | {"views": len(part)}
                printed.append(counted | _scores.overall(found))
        write_text(output, pandas.DataFrame(scored).to_csv(index=False))
    title = "Prediction, in transformed space"
    command.print_table(title, pandas.DataFrame(printed), _scores.FORMATS)
    print(f"written: {output}")


def _by_scene(judged: "Samples") -> dict[str, "Samples"]:
    """All of them, and those of each scene if there is more than one."""
    scenes = sorted(set(judged.scenes))
    parts = {scene: judged.of_scene(scene) for scene in scenes}
    return parts if len(scenes) == 1 else {"all": judged} | parts
