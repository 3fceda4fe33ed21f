"""`alsarr tables`: a folder of textures, and frames, made into tables for an engine."""

from collections.abc import Callable, Mapping
from contextlib import contextmanager
from pathlib import Path

import jax
import numpy as np
import typer
from jaxtyping import Float

from camojab import datasets, Pooled, Spectrum
from camojab._command import print_table, stages, Unusable
from camojab._table_command import check_encoding, model
from camojab._textures import folder_textures

from ._frame import load_frame
from ._rates import RATES
from .tables import (
    Constraint,
    distil,
    Domain,
    Eq31,
    Eq31LogTravel,
    Form,
    load_tables,
    QualityTables,
    sample,
    save_tables,
    Scene,
)
from .tables._checkpoint import forget
from .tables._distil import check_request
from .tables._rate_order import check_rates, SIDES
from .tables._scene import left_out, PUBLISHED_LEVELS


FORMS = {
    "eq31": Form(Eq31()),
    "eq31-two-step": Form(Eq31("two-step")),
    "eq31-log-travel": Form(Eq31LogTravel()),
}

Luminance = Float[np.ndarray, "rows columns"]


def make(
    *,
    textures: str,
    frames: list[Path],
    output: Path,
    tolerance: float | None,
    form: str | None,
    constraint: str | None,
    rates: str,
    absolute: bool,
    ppd: float,
    persistence: float,
    refresh_rate: tuple[float, float],
    formulation: str | None,
    parameters: Path | None,
    encoding: str | None,
    cells: int,
) -> None:
    """Sample the model, distil it, write the file, and print what it is good for."""
    if output.suffix.lower() not in (".json", ".npz") or output.is_dir():
        raise Unusable(f"{output}: must be a file to write that ends in .json or .npz.")
    check_encoding(encoding)
    names, relative_to = _rates(rates), None if absolute else "coarsest"
    ordered = None if constraint is None else Constraint(constraint)
    check_rates(names)
    check_request(names, relative_to, ordered, tolerance)
    constants, statement = model(formulation, parameters)
    images = _images(textures, encoding)
    spectra = {name: Spectrum.from_texture(image) for name, image in images.items()}
    scene = _scene(frames, len(spectra), refresh_rate)
    checkpoint = output.with_name(f".{output.name}.samples")
    with stages() as progress:
        samples = sample(
            spectra,
            scene,
            ppd=ppd,
            persistence=persistence,
            parameters=constants,
            formulation=statement,
            fidelity=Pooled(cells),
            rates=names,
            checkpoint=checkpoint,
            progress=lambda *n: progress("sampling", *n),
        )
        tables = distil(
            samples,
            None if form is None else FORMS[form],
            relative_to=relative_to,
            constraint=ordered,
            tolerance_jnd=tolerance,
            progress=lambda *n: progress("fitting", *n),
        )
    if jax.process_index() == 0:
        save_tables(output, tables)
    _wait_for_all()
    forget(checkpoint)
    if jax.process_index() == 0:
        print(f"{output}: {left_out(scene, list(spectra))}")
        _print_saving(tables, len(spectra))
        _print_certificate(tables)


def show(file: Path) -> None:
    """Print what tables are of, and how far they can be trusted."""
    tables = load_tables(file)
    domain = tables.domain
    ends = lambda x: "{:g} to {:g}".format(*np.asarray(x))
    print(f"{file}: {tables.num_textures} textures, {tables.model}")
    print(
        f"domain: velocity {ends(domain.velocity)} deg/s, refresh rate "
        f"{ends(domain.refresh_rate)} Hz, luminance {ends(domain.luminance)} cd/m^2"
    )
    print(f"{tables.basis.describe()}: {tables.basis.formula()}")
    print(f"rates {', '.join(tables.rates)}, relative to {tables.relative_to}")
    _print_certificate(tables)
    print()
    print_table("Errors by texture [JND]", _by_texture(tables))


@contextmanager
def processes(coordinator: str | None, number: int, index: int):
    """Take part in a computation of several processes.

    **Raises:** `ValueError` for several processes without a coordinator, or an index
    that none of them has: JAX would wait for the others in vain.
    """
    if coordinator is None and number != 1:
        raise ValueError(
            f"`--processes` must go with --coordinator, got {number} without."
        )
    if not 0 <= index < number:
        raise ValueError(f"`--process` must be from 0 to {number - 1}, got {index}.")
    if coordinator is None:
        yield
        return
    jax.distributed.initialize(coordinator, number, index)
    try:
        yield
    finally:
        jax.distributed.shutdown()


def _wait_for_all() -> None:
    """Nobody forgets what is done before it is written."""
    if jax.process_count() > 1:
        from jax.experimental.multihost_utils import sync_global_devices

        sync_global_devices("tables are written")


def _images(name: str, encoding: str | None) -> Mapping[str, Luminance]:
    published: dict[str, Callable[[], Mapping[str, Luminance]]] = {
        "builtin": datasets.builtin_textures,
        "jindal2021": datasets.jindal2021_textures,
    }
    if name in published:
        return published[name]()
    folder = Path(name)
    if not folder.is_dir():
        raise Unusable(
            f"`--textures` must be a folder, builtin or jindal2021, got {name}."
        )
    return folder_textures(folder, encoding)


def _scene(
    frames: list[Path], num_textures: int, refresh_rate: tuple[float, float]
) -> Scene:
    if not frames:
        return Scene.every(
            num_textures, PUBLISHED_LEVELS, Domain(refresh_rate=refresh_rate)
        )
    return Scene.of_frames(
        [load_frame(path) for path in frames],
        num_textures=num_textures,
        refresh_rate=refresh_rate,
    )


def _rates(text: str) -> tuple[str, ...]:
    if text == "separable":
        return SIDES
    names = tuple(text.split(","))
    unknown = [name for name in names if name not in RATES.names]
    if unknown:
        raise typer.BadParameter(
            f"must be separable or of {','.join(RATES.names)}, got {unknown[0]}.",
            param_hint="'--rates'",
        )
    return tuple(name for name in RATES.names if name in names)


def _print_saving(tables: QualityTables, num_textures: int) -> None:
    each = int(np.prod(tables.coefficients.shape[1:]))
    every = num_textures * len(PUBLISHED_LEVELS) * each
    constant = int(np.sum(np.asarray(tables.constant)))
    print(
        f"{tables.count} coefficients, {1 - tables.count / every:.1%} fewer than the "
        f"{every} of every texture at {len(PUBLISHED_LEVELS)} levels; "
        f"textures that are one constant: {constant}"
    )


def _print_certificate(tables: QualityTables) -> None:
    largest, percentile_99, median = np.asarray(tables.certificate.overall)
    n = tables.certificate.sample.velocity.size
    print(
        f"{tables.basis.name}: error over {n} held-out conditions: largest "
        f"{largest:.3g} JND, 99 % below {percentile_99:.3g}, median {median:.3g}"
    )
    if tables.meets is not None:
        verdict = "is met" if tables.meets else "is met by no form; this comes nearest"
        print(f"tolerance of {tables.tolerance_jnd:g} JND: {verdict}")


def _by_texture(tables: QualityTables):
    import pandas

    certificate, entry = tables.certificate, np.asarray(tables.entry)
    rows = []
    for name, own in zip(tables.texture_names, entry, strict=True):
        own = np.unique(own[own >= 0])
        if own.size:
            largest = np.asarray(certificate.largest)[own]
            median = np.median(np.asarray(certificate.median)[own])
            kind = "constant" if tables.constant[own[0]] else f"{own.size} levels"
            worst = np.asarray(certificate.percentile_99)[own].max()
            rows.append(
                (name, kind, f"{largest.max():.3g}", f"{worst:.3g}", f"{median:.3g}")
            )
    return pandas.DataFrame(
        rows, columns=["texture", "tables", "largest", "99 %", "median"]
    )
