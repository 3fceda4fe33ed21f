"""Samples of the model made into tables, with the cheapest form that is good enough."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._basis import AbstractBasis, Eq31, Eq31LogTravel, TensorPolynomial
from ._certificate import Certificate, percentiles
from ._domain import Conditions, Domain, Grid
from ._rate_order import Constraint, rate_order
from ._samples import Samples
from ._tables import index_entries, QualityTables


class Form(NamedTuple):
    """What a polynomial is made of.

    - `basis`: the family it belongs to.
    - `directions`: `"separate"` ones for motion in x and in y, or one `"shared"` by
      both, half as many.
    """

    basis: AbstractBasis
    directions: Literal["separate", "shared"] = "separate"

    @property
    def cost(self) -> int:
        """Numbers for one texture, mip level and rate."""
        return self.basis.num_coefficients * (1 + (self.directions == "separate"))


def forms(ppd: float) -> tuple[Form, ...]:
    """What a tolerance is met with on a display, cheapest first.

    The published form is not among them: it costs as much as the second and is less
    accurate.

    **Arguments:** `ppd`: of the display. [px/deg], > 0.
    """
    tensor = lambda *degrees: TensorPolynomial(degrees, 0.5 / ppd)
    return (
        Form(Eq31LogTravel(), "shared"),
        Form(Eq31LogTravel()),
        Form(tensor(3, 2, 3), "shared"),
        Form(tensor(3, 2, 3)),
        Form(tensor(4, 3, 4), "shared"),
        Form(tensor(4, 3, 4)),
        Form(tensor(6, 4, 5)),
        Form(tensor(8, 6, 5)),
    )


# Where a constraint is kept: conditions beside each other in the dense grid.
_DENSE = (17, 11, 9)


def distil(
    samples: Samples,
    form: Form | Sequence[Form] | None = None,
    *,
    relative_to: str | None = "coarsest",
    constraint: Constraint | None = None,
    tolerance_jnd: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> QualityTables:
    """Fit polynomials to a sampled model, and certify how far they are from it.

    **Arguments:**

    - `form`: of the polynomials; or several, cheapest first, of which the first that
      meets the tolerance is taken, and the most accurate if none does. Left out, Eq. 31
      with separate directions; with a tolerance, `forms(samples.ppd)`.
    - `relative_to`: name of the rate whose quality is 0, the coarsest of all unless
      another is named; `None` for the model's own quality, which `Polynomial` needs.
    - `constraint`: what is kept on a dense grid over the domain (`Grid.over` with 17
      velocities, 11 refresh rates and 9 luminances).
    - `tolerance_jnd`: the largest error that is good enough, > 0. A texture whose
      quality no rate and no condition changes by more becomes one constant.
    - `progress`: called with the forms tried and their number.

    **Returns:** tables in one form, with their `certificate`; `meets` says whether the
    tolerance is met.

    **Raises:** `ValueError` for a tolerance out of range, an unknown rate, several
    forms without a tolerance, or a constraint that does not go with the reference.

    **Source:** Jindal et al. 2021, Eq. 28, 29 and 31.

    **Example:**

    >>> import numpy as np
    >>> from alsarr.tables import distil, Domain, forms, sample, Scene
    >>> from camojab import Spectrum
    >>> noise = np.random.default_rng(0).uniform(size=(512, 512))
    >>> scene = Scene.every(1, mip_levels=(0,), domain=Domain(velocity=(5, 30)))
    >>> spectra = {"noise": Spectrum.from_texture(noise)}
    >>> samples = sample(spectra, scene, ppd=60.0)
    >>> tables = distil(samples, forms(ppd=60.0)[2], tolerance_jnd=1.0)
    >>> bool(tables.meets)
    False
    """
    relative_to = check_request(samples.rates, relative_to, constraint, tolerance_jnd)
    given = _given(form, tolerance_jnd, samples.ppd)
    target = _Target.of(samples, relative_to, constraint)
    flat = _flat_textures(target, tolerance_jnd)
    varied = np.array([t not in flat for t, _ in samples.scene.pairs])
    best = None
    for tried, one in enumerate(given):
        progress(tried, len(given))
        found = _fitted(one, target, varied)
        if best is None or found.largest < best.largest:
            best = found
        if tolerance_jnd is None or best.largest <= tolerance_jnd:
            break
    progress(len(given), len(given))
    assert best is not None
    return _tables(best, target, flat, tolerance_jnd)


def check_request(
    rates: tuple[str, ...],
    relative_to: str | None,
    constraint: Constraint | None,
    tolerance_jnd: float | None,
) -> str | None:
    """Fail for what `distil` cannot do, before any work; returns the reference's name.

    **Raises:** as `distil`.
    """
    if tolerance_jnd is not None and not tolerance_jnd > 0:
        raise ValueError(f"`tolerance_jnd` must be > 0 JND, got {tolerance_jnd:g}.")
    reference = rates[0] if relative_to == "coarsest" else relative_to
    if reference not in (*rates, None):
        raise ValueError(
            f"`relative_to` must be one of {', '.join(rates)} or None, got "
            f"{reference!r}."
        )
    if constraint is not None:
        rate_order(constraint, rates, reference)
    return reference


def _given(
    form: Form | Sequence[Form] | None, tolerance_jnd: float | None, ppd: float
) -> Sequence[Form]:
    if form is None:
        return (Form(Eq31()),) if tolerance_jnd is None else forms(ppd)
    several = (form,) if isinstance(form, Form) else tuple(form)
    if not several or (len(several) > 1 and tolerance_jnd is None):
        raise ValueError(
            f"`form` must be one without a tolerance, got {len(several)} forms."
        )
    return several


class _Target(NamedTuple):
    """Qualities to reproduce, relative to their reference. [JND]."""

    samples: Samples
    relative_to: str | None
    constraint: Constraint | None
    fitted: Float[np.ndarray, "pairs rates 2 grid"]
    tried: Float[np.ndarray, "pairs rates 2 sample"]

    @classmethod
    def of(
        cls, samples: Samples, relative_to: str | None, constraint: Constraint | None
    ) -> "_Target":
        quality, rates = samples.quality, samples.rates
        if relative_to is not None:
            at = rates.index(relative_to)
            quality = quality - quality[:, at : at + 1]
        chosen = samples.grid.velocity.size
        fitted, tried = quality[..., :chosen], quality[..., chosen:]
        return cls(samples, relative_to, constraint, fitted, tried)

    @property
    def free(self) -> list[int]:
        """The rates that are not 0 by definition."""
        return [i for i, r in enumerate(self.samples.rates) if r != self.relative_to]


class _Fitted(NamedTuple):
    form: Form
    coefficients: Float[np.ndarray, "varied rates directions c"]
    error: Float[np.ndarray, "varied rates directions sample"]
    largest: float


def _flat_textures(target: _Target, tolerance_jnd: float | None) -> dict[int, float]:
    """Textures that one number stands for within the tolerance, and that number."""
    if tolerance_jnd is None:
        return {}
    every = np.concatenate([target.fitted, target.tried], axis=-1)
    of = np.array([texture for texture, _ in target.samples.scene.pairs])
    flat = {}
    for texture in np.unique(of).tolist():
        low, high = every[of == texture].min(), every[of == texture].max()
        middle = 0.0 if target.relative_to is not None else float(low + high) / 2
        if max(high - middle, middle - low) <= tolerance_jnd:
            flat[texture] = middle
    return flat


def _fitted(form: Form, target: _Target, varied: np.ndarray) -> _Fitted:
    """One form fitted to all textures that are not flat."""
    basis, samples = form.basis, target.samples
    chosen = jnp.asarray(target.fitted[varied][:, target.free], float)
    if form.directions == "shared":
        # The same conditions twice: fitting both is fitting their mean.
        chosen = jnp.mean(chosen, axis=2, keepdims=True)
    pairs, rates, directions, n = chosen.shape
    shape = (pairs, len(samples.rates), directions, basis.num_coefficients)
    coefficients = np.zeros(shape, chosen.dtype)
    if pairs:
        coefficients[:, target.free] = _least_squares(basis, target, chosen)
    error = _errors(basis, target, coefficients, target.tried[varied])
    largest = float(error.max(initial=0.0))
    return _Fitted(form, coefficients, error, largest)


def _least_squares(
    basis: AbstractBasis, target: _Target, chosen: Float[Array, "pairs rates ways n"]
) -> Float[np.ndarray, "pairs rates ways c"]:
    samples, domain = target.samples, target.samples.scene.domain
    pairs, rates, ways, n = chosen.shape
    if target.constraint is None:
        flat = basis.fit(samples.grid, chosen.reshape(-1, n), domain)
        return np.asarray(flat).reshape(pairs, rates, ways, -1)
    order = rate_order(target.constraint, samples.rates, target.relative_to)
    dense = Grid.over(domain, _DENSE).conditions()
    together = jnp.moveaxis(chosen, 2, 1).reshape(-1, rates, n)
    found = basis.fit_ordered(samples.grid, together, domain, dense, order)
    return np.moveaxis(np.asarray(found).reshape(pairs, ways, rates, -1), 1, 2)


def _errors(
    basis: AbstractBasis,
    target: _Target,
    coefficients: Float[np.ndarray, "pairs rates ways c"],
    quality: Float[np.ndarray, "pairs rates 2 sample"],
) -> Float[np.ndarray, "pairs rates ways errors"]:
    """Of every polynomial under the held-out conditions; of a shared one, of both."""
    at, domain = target.samples.held_out, target.samples.scene.domain
    arrays = jnp.asarray(coefficients), jnp.asarray(quality, float)
    error = np.asarray(_apart(basis, *arrays, at, domain))
    pairs, rates, ways, _ = coefficients.shape
    return error.reshape(pairs, rates, ways, 2 // ways * at.velocity.size)


@eqx.filter_jit
def _apart(
    basis: AbstractBasis,
    coefficients: Float[Array, "pairs rates ways c"],
    quality: Float[Array, "pairs rates 2 sample"],
    at: Conditions,
    domain: Domain,
) -> Float[Array, "pairs rates 2 sample"]:
    everywhere = Conditions(*(x[None, None] for x in at))
    of = lambda c: basis.evaluate(c[:, :, None], everywhere, domain)
    return jnp.abs(jax.lax.map(of, coefficients) - quality)


def _tables(
    found: _Fitted, target: _Target, flat: dict[int, float], tolerance_jnd: float | None
) -> QualityTables:
    samples, basis = target.samples, found.form.basis
    rates, ways = found.coefficients.shape[1:3]
    coefficients, errors = [*found.coefficients], [*percentiles(found.error)]
    of = np.array([texture for texture, _ in samples.scene.pairs])
    for texture, value in flat.items():
        record = np.asarray(basis.constant(value))
        coefficients.append(np.broadcast_to(record, (rates, ways, record.size)))
        apart = np.abs(target.tried[of == texture] - np.float32(value))
        errors.append(percentiles(np.moveaxis(apart, 0, -1).reshape(rates, ways, -1)))
    owners: list[tuple[int, tuple[float, ...]]] = [
        (t, (level,)) for t, level in samples.scene.pairs if t not in flat
    ]
    for texture in flat:
        own = [level for t, level in samples.scene.pairs if t == texture]
        owners.append((texture, tuple(own)))
    levels = samples.scene.mip_levels
    entry, occurs = index_entries(samples.scene.num_textures, levels, owners)
    largest, percentile_99, median = np.moveaxis(np.stack(errors), -1, 0)
    every = [found.error[:, target.free].ravel()]
    for texture, value in flat.items():
        free = target.tried[of == texture][:, target.free]
        every.append(np.abs(free - np.float32(value)).ravel())
    return QualityTables(
        coefficients=np.stack(coefficients),
        entry=entry,
        occurs=occurs,
        constant=np.arange(len(coefficients)) >= len(found.coefficients),
        mip_levels=levels,
        domain=samples.scene.domain,
        certificate=Certificate(
            largest=largest,
            percentile_99=percentile_99,
            median=median,
            overall=percentiles(np.concatenate(every)),
            sample=samples.held_out,
        ),
        basis=basis,
        rates=samples.rates,
        texture_names=samples.texture_names,
        model=samples.model,
        relative_to=target.relative_to,
        tolerance_jnd=tolerance_jnd,
    )
