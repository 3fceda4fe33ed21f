"""What each fidelity costs and how far it is from exact, measured on this machine."""

import itertools
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed, ThreadPoolExecutor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float

from ._command import precision
from ._display import Components, Display, Shading, Viewing
from ._exact import Exact
from ._parameters import Formulation, Parameters
from ._pooled import Pooled
from ._quality import error_estimate, pool, pooled_quality, PooledTexture, quality
from ._spectrum import Spectrum


Progress = Callable[[str, int, int], None]
Texture = Float[np.ndarray, "rows columns"]
Jnd = Float[np.ndarray, "settings width"]

# Some of those that `Auto` chooses from.
CELLS = (2000, 5000, 10_000)
BATCHES = (1, 100, 10_000, 1_000_000)

# Of each fidelity this batch is always measured: a fraction of a second.
_FIRST_EXACT, _FIRST_POOLED = 10, 10_000

# Horizontal and vertical shading resolution: of these pairs differences are taken.
_RATES = ((1.0, 1.0), (0.5, 1.0), (0.5, 0.5), (0.25, 0.25))
# Conditions beside each other in every setting.
_WIDTH = 8
# What pooling depends on, by the columns of a table of conditions.
_SETTING = ("rate_x", "rate_y", "mip_level", "beta", "vrs")
_VIEW = (
    "mean_luminance_cd_m2",
    "refresh_rate_hz",
    "velocity_deg_s",
    "persistence",
    "ppd",
)
_SWITCHES = ("vrs", "eye_blur", "judder")
# Repeats end at this number, or when so many seconds are spent; 3 there always are.
_REPEATS = 7
_REPEATING_S = 0.5


class Case(NamedTuple):
    """One way to compute: a formulation, "32" or "64" bits and a fidelity."""

    formulation: Formulation
    bits: str
    fidelity: Exact | Pooled

    def names(self) -> dict[str, Any]:
        """The cells that name it in a table."""
        cells = self.fidelity.cells if isinstance(self.fidelity, Pooled) else None
        return {
            "formulation": self.formulation.value,
            "precision": f"float{self.bits}",
            "fidelity": "exact" if cells is None else f"{cells} cells",
        }

    def reference(self) -> "Case":
        return Case(self.formulation, "64", Exact())


def all_cases(cells: Sequence[int]) -> list[Case]:
    """Those that the others are judged by come first."""
    rungs = (Exact(), *map(Pooled, cells))
    ways = [(f, bits) for f in Formulation for bits in ("64", "32")]
    return [Case(*way, rung) for rung in rungs for way in ways]


class Grid(NamedTuple):
    """Conditions [settings, width] of one texture, by the columns of their table.

    Errors are taken over `table`, conditions of the table; `rates`, displays and
    velocities that are alike in all of the last settings but for the shading rate; and
    apart from these `tall`, those of the table whose power is 1 or more. What is left
    fills the grid up.
    """

    columns: dict[str, Float[np.ndarray, "settings width"]]
    table: Bool[np.ndarray, "settings width"]
    rates: Bool[np.ndarray, "settings width"]
    tall: Bool[np.ndarray, "settings width"]


def grids(
    conditions: Any, textures: Sequence[str], beta: float, seed: int
) -> dict[Formulation, dict[str, Grid]]:
    """The conditions of every formulation and texture.

    Those of the table, which are of the released formulation, in settings, so that each
    is pooled once; and for both the same displays and velocities at several rates.
    """
    names = [*_SETTING, *_VIEW, *_SWITCHES[1:]]
    own = {t: conditions[conditions["texture"] == t] for t in textures}
    settings = {
        t: [
            list(part[names].to_dict("records"))
            for _, part in rows.groupby([*_SETTING])
        ]
        for t, rows in own.items()
    }
    most = max(map(len, settings.values()))
    random = np.random.default_rng(seed)
    found = {formulation: {} for formulation in Formulation}
    for texture in textures:
        pairs = _pairs(random, beta)
        found[Formulation.PAPER][texture] = pairs
        both = zip(_filled(settings[texture], most), pairs, strict=True)
        found[Formulation.RELEASED][texture] = Grid(
            *jax.tree.map(lambda *x: np.concatenate(x), *zip(*both, strict=True))
        )
    return found


def _filled(settings: list[list[dict[str, float]]], most: int) -> Grid:
    """All textures get as many settings, or each would be compiled for anew."""
    unlike = lambda i: [settings[0][0] | {"mip_level": 20.0 + i}]
    fill = [unlike(i) for i in range(most - len(settings))]
    rows = [
        [row[min(i, len(row) - 1)] for i in range(_WIDTH)] for row in settings + fill
    ]
    columns = {
        name: np.array([[cell[name] for cell in row] for row in rows], float)
        for name in rows[0][0]
    }
    lengths = np.array([len(row) for row in settings] + [0] * len(fill))
    told = np.arange(_WIDTH) < lengths[:, None]
    tall = told & (columns["beta"] >= 1.0)
    return Grid(columns, told & ~tall, np.zeros_like(told), tall)


def _pairs(random: np.random.Generator, beta: float) -> Grid:
    """Displays and velocities within the ordinary range, each at every rate."""
    drawn = _scattered(random, _WIDTH)
    shape = (len(_RATES), _WIDTH)
    rates = np.repeat(np.array(_RATES)[:, :, None], _WIDTH, axis=2)
    columns = {name: np.broadcast_to(x, shape) for name, x in drawn.items()}
    columns |= {"rate_x": rates[:, 0], "rate_y": rates[:, 1]}
    columns["mip_level"] = np.full(shape, random.uniform(0.0, 4.0))
    columns["beta"] = np.full(shape, beta)
    columns |= {name: np.ones(shape) for name in _SWITCHES}
    none = np.zeros(shape, bool)
    return Grid(columns, none, ~none, none)


def _scattered(
    random: np.random.Generator, number: int
) -> dict[str, Float[np.ndarray, " number"]]:
    """Displays and velocities, log-uniform in the ordinary range."""
    between = lambda low, high: np.exp(
        random.uniform(np.log(low), np.log(high), number)
    )
    return {
        "mean_luminance_cd_m2": between(0.1, 1000.0),
        "refresh_rate_hz": between(20.0, 300.0),
        "velocity_deg_s": between(0.5, 100.0),
        "persistence": between(0.02, 1.0),
        "ppd": between(10.0, 120.0),
    }


# ---- errors


def errors(
    cases: Sequence[Case],
    textures: Mapping[str, Texture],
    on: Mapping[Formulation, Mapping[str, Grid]],
    progress: Progress,
) -> tuple[list[dict[str, Any]], dict[Case, dict[str, Jnd]]]:
    """A line for each case, and every quality behind it. [JND].

    **Arguments:** `cases`, with those that the others are judged by among them.
    """
    found: dict[Case, dict[str, Jnd]] = {case: {} for case in cases}
    estimates: dict[Case, list[float]] = {case: [] for case in cases}
    # Two, since compiling leaves a core idle.
    workers = ThreadPoolExecutor(2)
    try:
        jobs = {
            workers.submit(_evaluated, case, texture, on[case.formulation][name]): (
                case,
                name,
            )
            for case, (name, texture) in itertools.product(cases, textures.items())
        }
        for done, job in enumerate(as_completed(jobs), 1):
            case, name = jobs[job]
            found[case][name], own = job.result()
            estimates[case].append(own)
            progress("errors", done, len(jobs))
    finally:
        workers.shutdown(cancel_futures=True)
    rows = [
        {
            **_error_row(case, found[case], found[case.reference()], on),
            "estimate_jnd": max(estimates[case]),
        }
        for case in cases
    ]
    return rows, found


def _evaluated(case: Case, texture: Texture, grid: Grid) -> tuple[Jnd, float]:
    """Quality of every condition, and the estimate of its error, or NaN. [JND]."""
    with precision(case.bits):
        spectrum = Spectrum.from_texture(texture)
        jnd = quality(spectrum, **_arguments(grid, case))
        own = float("nan")
        # In the other precision it is the same number for twice the compiling.
        if case.bits == "32":
            own = error_estimate(spectrum, **_arguments(_of_rates(grid), case))
    return np.asarray(jnd, float), own


def _of_rates(grid: Grid) -> Grid:
    """The last settings: those at several rates."""
    last = slice(-len(_RATES), None)
    return Grid(
        {name: x[last] for name, x in grid.columns.items()},
        *(x[last] for x in grid[1:]),
    )


def _arguments(grid: Grid, case: Case) -> dict[str, Any]:
    """Of `quality`."""
    columns, p = grid.columns, Parameters.published(case.formulation)
    of_setting = {name: columns[name][:, :1] for name in _SETTING}
    constants = {name: np.asarray(value, float) for name, value in vars(p).items()}
    return {
        "display": Display(
            ppd=columns["ppd"],
            refresh_rate=columns["refresh_rate_hz"],
            luminance=columns["mean_luminance_cd_m2"],
            persistence=columns["persistence"],
        ),
        "viewing": Viewing(columns["velocity_deg_s"]),
        "shading": Shading(**{name: of_setting[name] for name in _SETTING[:3]}),
        "parameters": Parameters(**constants | {"beta": of_setting["beta"]}),
        "components": Components(
            vrs=of_setting["vrs"],
            eye_blur=columns["eye_blur"],
            judder=columns["judder"],
        ),
        "formulation": case.formulation,
        "fidelity": case.fidelity,
    }


def _error_row(
    case: Case,
    found: Mapping[str, Jnd],
    exact: Mapping[str, Jnd],
    on: Mapping[Formulation, Mapping[str, Grid]],
) -> dict[str, Any]:
    grids = on[case.formulation]
    error = {name: found[name] - exact[name] for name in grids}
    counted = {name: grid.table | grid.rates for name, grid in grids.items()}
    every = np.concatenate([abs(error[name][counted[name]]) for name in grids])
    table = [abs(error[name][grid.table]) for name, grid in grids.items()]
    rates = [abs(error[name][grid.rates]) for name, grid in grids.items()]
    tall = [
        abs(error[name][grid.tall] / exact[name][grid.tall])
        for name, grid in grids.items()
    ]
    apart = [
        np.ptp(error[name][grid.rates].reshape(len(_RATES), -1), axis=0)
        for name, grid in grids.items()
    ]
    return {
        **case.names(),
        "conditions": len(every),
        "largest_jnd": _largest([every]),
        "percentile_99_jnd": float(np.percentile(every, 99)),
        "median_jnd": float(np.median(every)),
        "largest_of_table_jnd": _largest(table),
        "largest_of_rates_jnd": _largest(rates),
        "difference_jnd": _largest(apart),
        "relative_at_large_beta": _largest(tall),
        "worst": _worst(error, counted, grids) if every.max() else "",
    }


def _largest(parts: Sequence[Float[np.ndarray, " n"]]) -> float:
    """NaN where there is nothing that something could be the largest of."""
    every = np.concatenate(parts)
    return float(every.max()) if every.size else float("nan")


def _worst(
    error: Mapping[str, Jnd],
    counted: Mapping[str, Bool[np.ndarray, "settings width"]],
    grids: Mapping[str, Grid],
) -> str:
    size = {name: np.where(counted[name], abs(error[name]), -1.0) for name in grids}
    name = max(size, key=lambda name: size[name].max())
    at = np.unravel_index(int(size[name].argmax()), size[name].shape)
    return _said(name, grids[name], at)


def _said(texture: str, grid: Grid, at: tuple[Any, ...]) -> str:
    c = {name: float(x[at]) for name, x in grid.columns.items()}
    return ", ".join(
        [
            texture,
            f"rate {c['rate_x']:.3g} x {c['rate_y']:.3g}",
            f"mip {c['mip_level']:.3g}",
            f"{c['velocity_deg_s']:.3g} deg/s",
            f"{c['refresh_rate_hz']:.4g} Hz",
            f"persistence {c['persistence']:.2g}",
            f"{c['ppd']:.3g} ppd",
            f"{c['mean_luminance_cd_m2']:.3g} cd/m2",
            f"beta {c['beta']:.3g}",
            *(f"no {name}" for name in _SWITCHES if not c[name]),
        ]
    )


# ---- times


class Clock:
    """Times of one texture, at half rate along the motion, by case and batch.

    Compiled ahead of time, so that compiling and running are apart, and memory is what
    XLA plans for arguments, results and what lies between them.
    """

    def __init__(self, texture: Texture, seed: int):
        self._texture = texture
        self._seed = seed
        self._pooled: dict[Case, PooledTexture] = {}
        self.pooling: dict[Case, dict[str, Any]] = {}

    def pool(self, case: Case) -> None:
        """Measure pooling, once a texture, mip level and rate."""
        with precision(case.bits):
            spectrum = Spectrum.from_texture(self._texture)
            shading, p = Shading(rate_x=0.5), Parameters.published(case.formulation)
            call = lambda *args: pool(
                *args, formulation=case.formulation, fidelity=case.fidelity
            )
            cost, pooled = _measured(eqx.filter_jit(call), spectrum, shading, p)
        self.pooling[case], self._pooled[case] = cost, pooled

    def evaluate(self, case: Case, batch: int) -> dict[str, Any]:
        """Measure a pooled texture's quality under so many displays and velocities."""
        drawn = _scattered(np.random.default_rng(self._seed), batch)
        with precision(case.bits):
            display = Display(
                ppd=drawn["ppd"],
                refresh_rate=drawn["refresh_rate_hz"],
                luminance=drawn["mean_luminance_cd_m2"],
                persistence=drawn["persistence"],
            )
            viewing = Viewing(drawn["velocity_deg_s"])
            cost, _ = _measured(pooled_quality, self._pooled[case], display, viewing)
        each = cost["run_s"] / batch
        return {**case.names(), "batch": batch, **cost, "condition_s": each}


def _measured(function: Any, *args: Any) -> tuple[dict[str, Any], Any]:
    start = time.perf_counter()
    compiled = function.lower(*args).compile()
    compile_s = time.perf_counter() - start
    planned = compiled.compiled.memory_analysis()
    found = jax.block_until_ready(compiled(*args))
    runs = _runs(lambda: jax.block_until_ready(compiled(*args)))
    space = (
        planned.argument_size_in_bytes
        + planned.output_size_in_bytes
        + planned.temp_size_in_bytes
    )
    cost = {
        "compile_s": compile_s,
        "run_s": statistics.median(runs),
        "repeats": len(runs),
        "memory_mib": space / 2**20,
    }
    return cost, found


def _runs(call: Callable[[], Any]) -> list[float]:
    """Seconds of each of some repeats."""
    runs: list[float] = []
    while len(runs) < _REPEATS and (len(runs) < 3 or sum(runs) < _REPEATING_S):
        start = time.perf_counter()
        call()
        runs.append(time.perf_counter() - start)
    return runs


def sweep(
    clock: Clock,
    cases: Sequence[Case],
    batches: Sequence[int],
    until: float,
    progress: Progress,
) -> tuple[list[dict[str, Any]], list[str]]:
    """A line for each case and batch, and the names of what there was no time for.

    One batch of every case is always measured; then, in order of size, those follow
    that should be done at the time `until`, as `time.monotonic` has it.
    """
    rows, first = [], {}
    for done, case in enumerate(cases, 1):
        clock.pool(case)
        most = _FIRST_EXACT if isinstance(case.fidelity, Exact) else _FIRST_POOLED
        batch = min(batches[-1], most)
        first[case] = clock.evaluate(case, batch)
        rows.append(first[case])
        progress("times", done, len(cases))
    left_out, todo = [], _remaining(cases, batches, first)
    for done, (case, batch) in enumerate(todo, 1):
        own = first[case]
        # One run that warms up and three repeats are the fewest.
        expected = own["compile_s"] + 4 * own["condition_s"] * batch
        if time.monotonic() + expected < until:
            rows.append(clock.evaluate(case, batch))
        else:
            left_out.append(f"{' '.join(case.names().values())} at {batch}")
        progress("batches", done, len(todo))
    return rows, left_out


def _remaining(
    cases: Sequence[Case], batches: Sequence[int], first: Mapping[Case, dict[str, Any]]
) -> list[tuple[Case, int]]:
    """The default formulation and precision before the others, then small batches."""
    todo = [
        (case, batch)
        for case in cases
        for batch in batches
        if batch != first[case]["batch"]
    ]
    default = lambda case: (
        case.formulation is not Formulation.RELEASED,
        case.bits != "32",
    )
    return sorted(todo, key=lambda job: (default(job[0]), job[1]))


# ---- the peer


def peer(
    module: Any,
    textures: Mapping[str, Texture],
    on: Mapping[str, Grid],
    exact: Mapping[str, Jnd],
    progress: Progress,
) -> dict[str, Any]:
    """What the line-by-line transcription of the released model takes, and its error.

    **Arguments:** `module`: with `amplitude` and `distortion`, as `tests/reference.py`.
    """
    p = Parameters.published()
    seconds, wrong = [], []
    for done, (name, texture) in enumerate(textures.items(), 1):
        spectrum = module.amplitude(texture)
        # Some of those at several rates, whose exponent is the published one.
        for at in ((-1, 0), (-2, 0), (-3, 0)):
            c = {key: float(x[at]) for key, x in on[name].columns.items()}
            start = time.perf_counter()
            spatial, temporal = module.distortion(
                spectrum,
                luminance=c.pop("mean_luminance_cd_m2"),
                refresh_rate=c.pop("refresh_rate_hz"),
                velocity=c.pop("velocity_deg_s"),
                **c,
            )
            seconds.append(time.perf_counter() - start)
            jnd = float(p.ws) * spatial + float(p.wt) * temporal
            wrong.append(abs(jnd - exact[name][at]))
        progress("peer", done, len(textures))
    return {
        "formulation": Formulation.RELEASED.value,
        "precision": "float64",
        "fidelity": "NumPy",
        "condition_s": statistics.median(seconds),
        "error_jnd": max(wrong),
        "repeats": len(seconds),
    }


# ---- both together


def rungs(
    cases: Sequence[Case],
    clock: Clock,
    error_rows: Sequence[dict[str, Any]],
    time_rows: Sequence[dict[str, Any]],
    beside: dict[str, Any] | None,
) -> list[dict[str, Any]]:
    """A line for each case: its largest error and its highest throughput."""
    rows = []
    for case in cases:
        names = case.names()
        own = next(row for row in error_rows if names.items() <= row.items())
        timed = [row for row in time_rows if names.items() <= row.items()]
        fastest = min(timed, key=lambda row: row["condition_s"])
        rows.append(
            {
                **names,
                "error_jnd": own["largest_jnd"],
                "conditions_per_s": 1.0 / fastest["condition_s"],
                "batch": fastest["batch"],
                "pooling_s": clock.pooling[case]["run_s"],
                "compile_s": clock.pooling[case]["compile_s"] + fastest["compile_s"],
                "memory_mib": fastest["memory_mib"],
                "times_peer": _ratio(case, fastest, beside),
            }
        )
    for row in rows:
        row["front"] = "yes" if _on_front(row, rows) else ""
    return rows


def _ratio(case: Case, fastest: dict[str, Any], beside: dict[str, Any] | None) -> float:
    if beside is None or case.formulation is not Formulation.RELEASED:
        return float("nan")
    return beside["condition_s"] / fastest["condition_s"]


def _on_front(row: dict[str, Any], rows: Sequence[dict[str, Any]]) -> bool:
    """No other of its formulation is as accurate and faster, or better at both."""
    return not any(
        other["formulation"] == row["formulation"]
        and other is not row
        and other["error_jnd"] <= row["error_jnd"]
        and other["conditions_per_s"] > row["conditions_per_s"]
        for other in rows
    )
