"""`alsarr train`: a network that predicts a metric, from captured viewpoints."""

from pathlib import Path
from typing import Annotated, Literal, TYPE_CHECKING

import typer

from camojab import _command as command

from . import _options


if TYPE_CHECKING:
    from .network import AbstractTransform, Samples


# What the library calls the options.
_OPTIONS = {
    "`paths`": "`CAPTURES`",
    "`names`": "`--channels`",
    "`layers`": "the number of `--groups`",
    "`groups[": "`--groups[",
    "`mean`": "the mean of the metric",
    "`ppd`": "`--ppd`",
    "`metric`": "`--metric`",
    "`outputs`": "`--outputs`",
    "`channels`": "`--channels`",
    "`crop`": "`--crop`",
    "`held_out`": "`--held-out`",
    "`learning_rate`": "`--learning-rate`",
    "`learning_decay`": "`--learning-decay`",
}

# Not in [0, 1], for which the logistic transform is.
_UNBOUNDED = ("jnflip", "jnyang", "psnr")

MetricName = Literal["flip", "jnflip", "psnr", "yang", "jnyang"]


def train(
    captures: _options.Captures,
    ppd: Annotated[
        float, typer.Option(help="Pixels per degree that the metric is seen at.")
    ],
    metric: Annotated[
        MetricName, typer.Option(help="What the network is to predict.")
    ] = "flip",
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The NPZ file to write, whole.")
    ] = Path("network.npz"),
    outputs: Annotated[
        str,
        typer.Option(
            help="Rates to predict, comma-separated; the others follow from them."
        ),
    ] = "1x2,2x1,2x4,4x2",
    channels: Annotated[
        str | None,
        typer.Option(
            help="Inputs, comma-separated; left out they are the four of the paper."
        ),
    ] = None,
    groups: Annotated[
        str, typer.Option(help="Groups of the convolutions, layer by layer.")
    ] = "1,1,2,4,1",
    transform: Annotated[
        Literal["clamped", "logistic"],
        typer.Option(
            help="Of the metric, about its mean over the views; logistic is for flip "
            "and yang."
        ),
    ] = "clamped",
    steps: Annotated[int, typer.Option(min=1, help="Steps in all.")] = 4000,
    batch: Annotated[int, typer.Option(min=1, help="Views a step.")] = 8,
    crop: Annotated[
        str | None,
        typer.Option(
            help="Width x height that a step takes of a view, such as 256x256."
        ),
    ] = None,
    held_out: Annotated[
        int, typer.Option(min=1, help="Views of each scene that are only judged by.")
    ] = 12,
    learning_rate: Annotated[float, typer.Option(help="Of RMSprop.")] = 1e-4,
    learning_decay: Annotated[
        float, typer.Option(help="Factor of the learning rate from step to step.")
    ] = 1.0,
    patience: Annotated[
        int | None,
        typer.Option(min=1, help="Evaluations without improvement to stop after."),
    ] = None,
    every: Annotated[
        int, typer.Option(min=1, help="Steps between evaluations and checkpoints.")
    ] = 100,
    seed: Annotated[int, typer.Option(help="Of all that is random.")] = 0,
) -> None:
    """Train a network, and judge it by views that it did not learn from.

    An interrupted run goes on from the checkpoint beside the file it writes, and gives
    the numbers that it would have given; more steps may be asked for.
    """
    if output.suffix.lower() != ".npz" or output.is_dir():
        raise command.Unusable(f"{output}: must be a file to write that ends in .npz.")
    shape = None if crop is None else _options.size(crop, "--crop")
    layers = _options.counts(groups, "--groups")
    _check_transform(transform, metric)
    with command.usable(_OPTIONS), command.stages() as progress:
        import equinox as eqx

        from .capture import views
        from .network import (
            ClampedTransform,
            DEFAULT_CHANNELS,
            evaluate,
            initial_network,
            load_samples,
            save_network,
            score_table,
            train as fit,
            with_safety_offset,
        )
        from .network._train import check_settings

        names = tuple(channels.split(",")) if channels else DEFAULT_CHANNELS
        rates = tuple(outputs.split(","))
        # Settings are checked before the metric, which takes long, has a mean.
        start = initial_network(
            seed,
            metric=metric,
            ppd=ppd,
            transform=ClampedTransform(1.0),
            channels=names,
            outputs=rates,
            groups=layers,
        )
        check_settings(
            region=start.region,
            crop=shape,
            learning_rate=learning_rate,
            learning_decay=learning_decay,
        )
        samples = load_samples(
            [path for folder in captures for path in views(folder)],
            metric=metric,
            ppd=ppd,
            channels=names,
            outputs=rates,
            progress=lambda done, total: progress("metric", done, total),
        )
        learned, judged = samples.split(held_out, seed=seed)
        about = _transform(transform, metric, learned)
        training = fit(
            eqx.tree_at(lambda n: n.transform, start, about),
            learned,
            steps=steps,
            batch=batch,
            seed=seed,
            held_out=judged,
            crop=shape,
            learning_rate=learning_rate,
            learning_decay=learning_decay,
            every=every,
            patience=patience,
            checkpoint=output.with_suffix(".checkpoint.npz"),
            progress=lambda done, total, loss: progress("training", done, total),
        )
        network = with_safety_offset(training.network, judged)
        save_network(output, network)
        scores = score_table(evaluate(network, judged))
    print(
        f"{output}: {metric} from {len(learned)} views, best after step "
        f"{training.step} of {training.steps}, safety offset "
        f"{float(network.safety_offset):.4f}"
    )
    print(scores)


def _check_transform(kind: str, metric: str) -> None:
    if kind == "logistic" and metric in _UNBOUNDED:
        raise typer.BadParameter(
            f"must be clamped with --metric {metric}, got {kind}.",
            param_hint="'--transform'",
        )


def _transform(
    kind: Literal["clamped", "logistic"], metric: str, samples: "Samples"
) -> "AbstractTransform":
    """About the mean of what is learned; for PSNR that of the released network."""
    from .network import ClampedTransform, LogisticTransform

    if metric == "psnr":
        return ClampedTransform(-0.015, 1.0)
    mean = samples.mean()
    if kind == "logistic":
        return LogisticTransform(mean)
    return ClampedTransform.from_mean(mean)
