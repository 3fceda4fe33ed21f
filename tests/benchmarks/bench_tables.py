"""What tables cost, and how far they are from the model.

    python tests/benchmarks/bench_tables.py [PART ...]

of forms, constraints, programmes, authors, scenes and time; all if none is named.
"""

import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

from alsarr import Frame, procedural_frame, RATES
from alsarr.tables import (
    Conditions,
    Constraint,
    distil,
    Eq31,
    Eq31LogTravel,
    Form,
    forms,
    Grid,
    sample,
    Scene,
    TensorPolynomial,
)
from alsarr.tables._basis import AbstractBasis
from alsarr.tables._rate_order import rate_order
from camojab import datasets, luminance, Spectrum


PPD = 60.0
# As dense as where constraints are kept, but in other places.
DENSE = Grid(
    velocity=tuple(np.linspace(0, 50, 26)),
    refresh_rate=tuple(np.linspace(30, 120, 19)),
    log10_luminance=tuple(np.linspace(-1, 2.5, 15)),
).conditions()


def spectra(name):
    images = {"built-in": datasets.builtin_textures}.get(name, _jindal2021)()
    return {k: Spectrum.from_texture(jnp.asarray(v, float)) for k, v in images.items()}


def _jindal2021():
    wood = luminance(datasets.jindal2021_sample_texture(), encoding="sRGB")
    return {**datasets.jindal2021_textures(), "wood": wood}


def samples(name, levels=range(12), **more):
    textures = spectra(name)
    return sample(textures, Scene.every(len(textures), levels), ppd=PPD, **more)


def row(*cells):
    widths = (34, 10, 10, 10, 10, 10)
    print("".join(str(c).ljust(w) for c, w in zip(cells, widths, strict=False)))


def jnd(certificate):
    return [f"{x:.4f}" for x in np.asarray(certificate.overall)]


def show_forms():
    several = (
        Form(Eq31("two-step")),
        Form(Eq31(), "shared"),
        Form(Eq31()),
        *forms(PPD),
    )
    for name in ("built-in", "jindal2021"):
        of = samples(name)
        print(f"\n{name}, 12 levels: errors over 1032 held-out conditions [JND]")
        row("form", "numbers", "largest", "99 %", "median", "fit [s]")
        for form in several:
            start = time.perf_counter()
            made = distil(of, form)
            took = time.perf_counter() - start
            basis = form.basis.describe()
            label = " ".join(map(str, [*basis.values()][:2])) + " " + form.directions
            row(label[:33], form.cost, *jnd(made.certificate), f"{took:.2f}")


def falls(tables, order):
    """How much worse the better of two rates is at most [JND], and how often."""
    domain, at = tables.domain, Conditions(*(x[None, None] for x in DENSE))
    free = [i for i, r in enumerate(tables.rates) if r != tables.relative_to]
    of = jax.jit(lambda c: tables.basis.evaluate(c[:, :, None], at, domain))
    worst, count, total = 0.0, 0, 0
    for entry in tables.coefficients:
        found = np.asarray(of(entry))[free]
        for better, worse in order.pairs:
            fall = (found[worse] if worse >= 0 else 0.0) - found[better]
            worst, count = max(worst, fall.max()), count + np.sum(fall > 0)
            total += fall.size
    return worst, count / total


def show_constraints():
    both = [rate_order(c, RATES.names, "4x4") for c in Constraint]
    for name in ("built-in", "jindal2021"):
        of = samples(name)
        print(f"\n{name}: errors [JND], and falls below 4x4 and below a coarser rate")
        row("form, constraint", "largest", "99 %", "median", "gain", "monotone")
        model = of.quality - of.quality[:, :1]
        fall = [(model[:, a] - model[:, b]).min() for a, b in _pairs(both[1])]
        print(f"the model itself falls by up to {-min(fall):.3g} JND")
        for form in (Form(Eq31()), Form(Eq31LogTravel()), forms(PPD)[3]):
            for constraint in (None, *Constraint):
                start = time.perf_counter()
                made = distil(of, form, constraint=constraint)
                took = time.perf_counter() - start
                label = f"{form.basis.name} {form.cost}, {constraint or 'none'}"
                worst = [f"{w:.3f} {s:.1%}" for w, s in (falls(made, o) for o in both)]
                row(label, *jnd(made.certificate), *worst)
                print(f"    {took:.1f} s")


def _pairs(order):
    return [(a + 1, b + 1) for a, b in order.pairs]


def show_authors():
    """The published tables: do they keep what the paper's solver relies on?"""
    stored = datasets.jindal2021_material_tables()
    found = np.asarray(_eq31(np.asarray(stored.coefficients)))
    half, full = found[:, :, 0], found[:, :, 1]
    print("\nThe authors' 50 materials x 12 levels, over their domain:")
    for label, fall in (
        ("half below quarter", -half),
        ("full below half", half - full),
    ):
        print(f"  {label}: by up to {fall.max():.3g} JND, {np.mean(fall > 0):.1%}")


def _eq31(w):
    basis: AbstractBasis = Eq31()
    at = Conditions(*(x[None, None, None] for x in DENSE))
    return basis.evaluate(jnp.asarray(w, float)[:, :, :, None], at, None)


def show_scenes():
    print("\nWhat scenes need")
    row("scene", "pairs", "of", "numbers", "largest", "form")
    textures = spectra("built-in")
    frame = procedural_frame(len(textures), rows=68, columns=120, seed=2021)
    own = Scene.of_frames([frame], num_textures=len(textures), refresh_rate=(30, 120))
    for tolerance in (None, 1.0, 0.5):
        for name, scene in (("all", Scene.every(len(textures))), ("drawn frame", own)):
            of = sample(textures, scene, ppd=PPD)
            made = distil(of, tolerance_jnd=tolerance)
            row(
                f"{name}, tolerance {tolerance}",
                len(scene.pairs),
                12 * len(textures),
                made.count,
                f"{float(made.largest_error):.3f}",
                f"{made.basis.name}, {np.sum(np.asarray(made.constant))} constants",
            )
    _scifi()


def _scifi():
    from alsarr import frame_from_jindal2021

    stored = datasets.jindal2021_frame()
    frame: Frame = frame_from_jindal2021(
        motion_x=stored.motion_x,
        motion_y=stored.motion_y,
        material=stored.material,
        mip_level=stored.mip_level,
    )
    scene = Scene.of_frames([frame], num_textures=50, refresh_rate=(30, 120))
    v = np.asarray(scene.domain.velocity)
    print(
        f"SciFi frame: {len(scene.pairs)} of 600 pairs of material and level, velocity "
        f"{v[0]:.3g} to {v[1]:.3g} deg/s; {140 * len(scene.pairs)} numbers of 84000"
    )


def show_programmes():
    """One ordered fit by our own solver, and the same programme by others."""
    from alsarr.tables._constrained import fit_constrained_linear

    grass = {"grass": spectra("built-in")["grass"]}
    of = sample(grass, Scene.every(1, (0,)), ppd=PPD)
    basis, domain = TensorPolynomial((2, 2, 3), 0.5 / PPD), of.scene.domain
    # An orthonormal design makes the programme the nearest point.
    design, r = np.linalg.qr(np.asarray(basis._design(of.grid, domain), float))
    dense = Grid.over(domain, (9, 6, 5)).conditions()
    grid = np.asarray(basis._design(dense, domain), float) @ np.linalg.inv(r)
    quality = of.quality[0, :, 0, : len(design)].astype(float)
    target = (quality - quality[:1])[1:]
    order = rate_order(Constraint.MONOTONE, RATES.names, "4x4")
    free = (target @ design).ravel()
    rows = np.zeros((len(order.pairs), len(target)))
    for row_, (better, worse) in zip(rows, order.pairs, strict=True):
        row_[better] = 1
        if worse >= 0:
            row_[worse] = -1
    bounds = np.einsum("rk,mp->rmkp", rows, grid).reshape(-1, free.size)
    print(f"\none table, {free.size} unknowns, {len(bounds)} bounds")
    row("solver", "time [s]", "distance", "violation")
    with jax.enable_x64(True):
        arrays = [jnp.asarray(x) for x in (design, target, grid)]
        solvers = {
            "own": lambda: fit_constrained_linear(*arrays, order.pairs, order.margin),
            **_others(free, bounds, order.margin),
        }
        for name, solve in solvers.items():
            jax.block_until_ready(solve())
            start = time.perf_counter()
            found = np.asarray(jax.block_until_ready(solve()), float).ravel()
            took = time.perf_counter() - start
            distance = np.linalg.norm(found - free)
            fall = order.margin - np.min(bounds @ found)
            row(name, f"{took:.3f}", f"{distance:.6f}", f"{fall:.1e}")


def _others(free, bounds, margin):
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        from jaxopt import OSQP
    square, limits = jnp.eye(free.size), jnp.full(len(bounds), -margin)
    pull, below = jnp.asarray(-free), jnp.asarray(-bounds)
    osqp = OSQP(tol=1e-3, maxiter=4000)
    run = jax.jit(lambda: osqp.run(None, (square, pull), None, (below, limits)))
    found = {"jaxopt OSQP, 4000 steps": lambda: run().params.primal}
    try:
        import qpax
    except ImportError:
        return found
    none = jnp.zeros((0, free.size)), jnp.zeros(0)
    inner = jax.jit(lambda: qpax.solve_qp(square, pull, *none, below, limits)[0])
    return found | {"qpax": inner}


def show_time():
    print("\n600 tables, 50 drawn textures x 12 levels, seven rates, two directions")
    random, base = np.random.default_rng(0), list(datasets.builtin_textures().values())
    textures = {}
    for i in range(50):
        image = np.roll(base[i % 6], random.integers(0, 512, 2), (0, 1))
        image = np.clip(image, 0, 1) ** (0.5 + i / 25)
        textures[f"{i}"] = Spectrum.from_texture(jnp.asarray(image, float))
    start = time.perf_counter()
    of = sample(textures, Scene.every(50), ppd=PPD)
    sampled = time.perf_counter() - start
    made = distil(of)
    both = time.perf_counter() - start
    print(f"sampling {sampled:.1f} s, with fitting and certificates {both:.1f} s")
    start = time.perf_counter()
    distil(of, Form(Eq31LogTravel()), constraint=Constraint.MONOTONE)
    print(f"monotone, log travel: fitting {time.perf_counter() - start:.1f} s")
    print(f"largest, 99 %, median [JND]: {', '.join(jnd(made.certificate))}")


if __name__ == "__main__":
    asked = sys.argv[1:] or [
        "forms",
        "constraints",
        "programmes",
        "authors",
        "scenes",
        "time",
    ]
    print(f"jax {jax.__version__}, {jnp.result_type(float)}, {jax.devices()}")
    for part in asked:
        globals()[f"show_{part}"]()
