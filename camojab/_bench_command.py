"""`camojab bench`: what accuracy costs on this machine."""

import importlib.util
import os
import platform
import resource
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from . import datasets
from ._bench import (
    all_cases,
    BATCHES,
    Case,
    CELLS,
    Clock,
    errors,
    grids,
    peer,
    rungs,
    sweep,
)
from ._command import print_table
from ._exact import Exact
from ._files import replacing
from ._page import png
from ._parameters import Formulation, Parameters
from ._results import (
    check_folder,
    EXPERIMENT,
    provenance,
    quote,
    records,
    save,
    to_csv,
    to_json,
)
from ._shipped import shipped


FILES = ("bench.json", "bench.csv", "bench.png")
CONDITIONS = "bench_conditions.csv"

_STIMULI = f"{EXPERIMENT}/vrs_exp_stimulus.mat"
# Which of the built-in textures stands for each published one.
_STAND_INS = {
    "checkerboard": "checkerboard",
    "gradient_linear": "gradient",
    "grass": "grass",
    "noise": "noise",
    "marrr_checkerboard": "brick",
}
_FORMATS = {
    "error_jnd": ".2g",
    "estimate_jnd": ".2g",
    "largest_jnd": ".2g",
    "percentile_99_jnd": ".2g",
    "median_jnd": ".2g",
    "largest_of_table_jnd": ".2g",
    "largest_of_rates_jnd": ".2g",
    "difference_jnd": ".2g",
    "relative_at_large_beta": ".2g",
    "conditions_per_s": ".3g",
    "pooling_s": ".3g",
    "compile_s": ".2f",
    "run_s": ".3g",
    "condition_s": ".3g",
    "memory_mib": ".1f",
    "times_peer": ".3g",
}
_ERRORS = (
    "Errors are differences to exact in float64. The published constants go with "
    "beta 0.36, so conditions of the table whose beta is 1 or more, with energies of "
    "thousands, are apart from the others, as errors relative to the quality. "
    "difference is the largest error of the difference between two rates, all else "
    "being equal. estimate is the rung's own of largest_of_rates, computed in float32."
)
_TIMES = (
    "Times are medians of runs after compiling, and memory is what XLA plans for "
    "arguments, results and temporaries of one call, not the process's. A rung's "
    "pooling time is spent once a texture, mip level, rate and beta."
)


class _Textures(NamedTuple):
    arrays: dict[str, Float[np.ndarray, "rows columns"]]
    source: str
    files: dict[str, Path]
    note: str


def bench(
    *,
    seconds: float,
    seed: int,
    output: Path,
    progress: Callable[[str, int, int], None],
) -> None:
    """Measure, write the files of `FILES` into the folder, and print the tables."""
    until = time.monotonic() + seconds
    check_folder(output, FILES)
    textures = _textures()
    beta = float(Parameters.published().beta)
    on = grids(_conditions(), list(textures.arrays), beta, seed)
    cases = all_cases(CELLS)
    error_rows, found = errors(cases, textures.arrays, on, progress)
    beside, of_peer = _beside(textures, on, found, progress)
    clock = Clock(textures.arrays["grass"], seed)
    time_rows, left_out = sweep(clock, cases, BATCHES, until, progress)
    tables = _tables(
        rungs(cases, clock, error_rows, time_rows, beside), error_rows, time_rows
    )
    notes = [textures.note, _ERRORS, _TIMES, of_peer]
    if left_out:
        notes.append(
            f"There was no time (--seconds {seconds:g}) for {len(left_out)} batches: "
            f"{'; '.join(left_out[:3])}{'; ...' if len(left_out) > 3 else '.'}"
        )
    document = {
        **provenance(
            "camojab-bench/1",
            {CONDITIONS: shipped(CONDITIONS), **textures.files},
            seed,
        ),
        "machine": _machine(),
        "textures": textures.source,
        "peer": beside,
        **{name: records(table) for name, table in tables.items()},
        "left_out": left_out,
        "notes": notes,
    }
    _write(output, document, tables["rungs"])
    _print(tables, beside)
    for note in notes:
        print(note)
    print(f"to quote: {quote(textures.source, _machine_line())}")
    print(f"written: {', '.join(str(output / each) for each in FILES)}")


def _textures() -> _Textures:
    """The published textures, or in their place others that need no download."""
    try:
        arrays = datasets.jindal2021_textures()
    except datasets.MissingData as error:
        built_in = datasets.builtin_textures()
        arrays = {name: built_in[own] for name, own in _STAND_INS.items()}
        pairs = ", ".join(f"{own} for {name}" for name, own in _STAND_INS.items())
        return _Textures(
            arrays, "built-in textures", {}, f"Built-in textures: {pairs}. {error}"
        )
    files = {_STIMULI: datasets.fetch(_STIMULI)}
    name = "textures of Jindal et al. 2021"
    return _Textures(arrays, name, files, f"The {name}.")


def _conditions() -> Any:
    import pandas as pd

    return pd.read_csv(shipped(CONDITIONS))


def _beside(
    textures: _Textures, on: Any, found: Any, progress: Any
) -> tuple[dict[str, Any] | None, str]:
    """The peer's time and error, and a note on it."""
    # It is an oracle of the tests and shares no code with the package, so that only a
    # checkout has it.
    path = Path(__file__).parents[1] / "tests" / "reference.py"
    spec = importlib.util.spec_from_file_location("reference", path)
    if not path.is_file() or spec is None or spec.loader is None:
        return None, (
            "times_peer is empty: the NumPy transcription of the released model, "
            "tests/reference.py, comes with a checkout only."
        )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    exact = Case(Formulation.RELEASED, "64", Exact())
    return (
        peer(module, textures.arrays, on[Formulation.RELEASED], found[exact], progress),
        "times_peer is the throughput in units of that of tests/reference.py, the "
        "released model line by line in NumPy, which evaluates every condition whole.",
    )


def _tables(
    of_rungs: list[dict[str, Any]],
    of_errors: list[dict[str, Any]],
    of_times: list[dict[str, Any]],
) -> dict[str, Any]:
    import pandas as pd

    # Released before paper and double before single, as the errors are explained.
    rank = lambda row: (row["formulation"] != "released", row["precision"] != "float64")
    table = lambda rows: pd.DataFrame(sorted(rows, key=rank))
    return {
        "rungs": table(of_rungs),
        "errors": table(of_errors),
        "times": table(sorted(of_times, key=lambda row: row["batch"])),
    }


def _write(output: Path, document: Mapping[str, Any], main: Any) -> None:
    """All files, or none of them."""
    from .plotting import error_and_throughput

    picture = png(error_and_throughput(main))
    with replacing(output / FILES[2]) as temporary:
        temporary.write_bytes(picture)
        contents = (to_json(document), to_csv(main))
        save(output, dict(zip(FILES[:2], contents, strict=True)))


def _print(tables: Mapping[str, Any], beside: dict[str, Any] | None) -> None:
    errors = tables["errors"]
    for formulation, part in tables["rungs"].groupby("formulation", sort=False):
        title = f"Accuracy and throughput, {formulation} formulation"
        print_table(title, part.drop(columns="formulation"), _FORMATS)
    if beside:
        print(
            f"NumPy transcription: {beside['condition_s']:.3g} s a condition, within "
            f"{beside['error_jnd']:.1g} JND of exact.\n"
        )
    print_table("Errors", errors.drop(columns="worst"), _FORMATS)
    worst = errors[["formulation", "precision", "fidelity", "largest_jnd", "worst"]]
    print_table("Worst conditions", worst[worst["worst"] != ""], _FORMATS)
    print_table("Times by batch", tables["times"], _FORMATS)


def _machine() -> dict[str, Any]:
    import jax

    device = jax.devices()[0]
    # On Linux in KiB, on macOS in bytes.
    unit = 1 if platform.system() == "Darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return {
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
        "jaxlib": version("jaxlib"),
        "device": f"{device.platform} ({device.device_kind})",
        "process_peak_mib": peak / 2**20,
    }


def _machine_line() -> str:
    found = _machine()
    return f"{found['platform']}, {found['cpus']} CPUs, device {found['device']}"
