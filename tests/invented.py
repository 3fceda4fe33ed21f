"""Experiments on textures that were never drawn: energies from random numbers.

A fit sees of a texture no more than the moments of its energies, so invented moments
make a fit of milliseconds, of conditions that differ as much as a test needs.
"""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from camojab import fit, Parameters
from camojab.fit import _problem
from camojab.fit._targets import VoteTarget
from camojab.votes import simulate


SIGMA = 1.4826022185056018
TRUTH = {"ws": -4.0, "wt": -5.0, "beta": 0.45}
SCALES = {"refresh": 1.8, "judder": 4.0}
FREE = ("ws", "wt", "beta", "scale:refresh", "scale:judder")
TRUE_VALUES = (*TRUTH.values(), *SCALES.values())
START = Parameters(ws=-1.0, wt=-1.0, beta=0.36)

_GROUPS = (
    ("rates", "A", "slow", 6),
    ("rates", "B", "fast", 6),
    ("refresh", "refresh", "refresh", 5),
    ("judder", "judder", "judder", 5),
)


@functools.cache
def _table():
    rows = []
    for data_set, block, group, count in _GROUPS:
        start = len(rows)
        for k in range(count):
            rows.append(
                {
                    "texture": "brick" if k % 2 else "grass",
                    "condition": f"c{k}",
                    "group": group,
                    "data_set": data_set,
                    "block": block,
                    "reference": start,
                    "temporal_only": data_set == "judder",
                    "velocity_deg_s": {"slow": 5.0, "fast": 20.0}.get(group, 10.0),
                    "refresh_rate_hz": 60.0 + 10 * k,
                    "rate_x": 1.0 / (k + 1),
                }
            )
    return pd.DataFrame(rows)


def table():
    """Two blocks of shading rates, refresh rates, and judder alone."""
    return _table().copy()


@functools.cache
def moments():
    """Of every row of `table`: more is lost from row to row of a group."""
    draw, nodes = np.random.default_rng(0), 5
    group = np.repeat(np.arange(len(_GROUPS)), [count for *_, count in _GROUPS])
    step = _table().groupby("group").cumcount().to_numpy()[:, None]
    reference = draw.normal(0.0, 2.0, (len(_GROUPS), nodes))[group]
    lost = 0.4 * (1 + step) * draw.uniform(0.1, 1.0, (len(group), nodes))
    replica = reference - draw.uniform(0.0, 6.0, (len(group), nodes))
    weight = 0.2 * draw.uniform(0.5, 1.5, (len(_GROUPS), 1, nodes))[group]
    log = np.stack([reference, reference - lost, replica], axis=1)
    weight = weight * np.ones((1, 3, 1))
    return fit.Moments(jnp.asarray(log, float), jnp.asarray(weight, float))


def quality(constants=TRUTH, scales=SCALES):
    """Of the rows of `table`, relative to their references [JND], in plain NumPy."""
    log, weight = (np.asarray(x, np.float64) for x in (moments().log, moments().weight))
    energy = np.sum(weight * np.exp(constants["beta"] * log), axis=-1)
    spatial, temporal = energy[:, 0] - energy[:, 1], energy[:, 2]
    both = constants["ws"] * spatial + constants["wt"] * temporal
    value = np.where(_table()["temporal_only"], -temporal, both)
    scale = _table()["data_set"].map({"rates": 1.0} | scales).to_numpy()
    return scale * (value - value[_table()["reference"]])


def pairs():
    """Every two rows of a group, the lower one first."""
    rows = _table().groupby("group", sort=False).indices.values()
    return np.array([ab for own in rows for ab in itertools.combinations(own, 2)])


def preference(lapse=0.0, values=None):
    """Probability that the first of each of `pairs` is preferred, in plain NumPy."""
    value = quality() if values is None else values
    a, b = pairs().T
    return 0.5 * lapse + (1 - lapse) * norm.cdf((value[a] - value[b]) / SIGMA)


def expected_votes(each, lapse=0.0):
    """So many votes on each pair, without the noise of casting them."""
    a, b = (jnp.asarray(side, jnp.int32) for side in pairs().T)
    wins = jnp.asarray(each * preference(lapse), float)
    return VoteTarget(a, b, wins, jnp.full_like(wins, each))


def textures():
    return {"brick": np.full((2, 3), 0.5), "grass": np.eye(3)}


def comparisons(
    observers=12, seed=0, data_sets=("rates", "refresh", "judder"), lapse=0.0
):
    """Every observer votes once on every pair, or guesses."""
    rows = _table()
    a, b = np.tile(pairs().T, observers)
    draw = np.random.default_rng(seed)
    preferred = simulate(quality()[a], quality()[b], draw)
    guessed = draw.random(len(a)) < lapse
    preferred = np.where(guessed, draw.random(len(a)) < 0.5, preferred)
    votes = pd.DataFrame(
        {
            "observer": np.repeat([f"o{k}" for k in range(observers)], len(pairs())),
            "group": rows["group"].to_numpy()[a],
            "condition_a": rows["condition"].to_numpy()[a],
            "condition_b": rows["condition"].to_numpy()[b],
            "a": a,
            "b": b,
            "a_preferred": preferred,
        }
    )
    # The data sets are the table's in its order, so that rows keep their numbers.
    kept = rows["data_set"].isin(data_sets)
    assert kept.is_monotonic_decreasing
    votes = votes[kept.to_numpy()[votes["a"]]].reset_index(drop=True)
    return fit.Comparisons(table()[kept], votes, textures())


def observations(noise=0.0, seed=0):
    """The true qualities, each but the references with normal noise. [JND]."""
    whole = table()
    relative = whole["reference"] != whole.index
    error = np.random.default_rng(seed).normal(0.0, 1.0, len(whole)) * relative
    measured = quality() + noise * error
    return fit.Observations(whole.assign(quality_jnd=measured), textures())


def fitted(data, *, target=None, **options):
    """`fit.fit` with the moments of `moments`, and `target` in the place of votes."""
    place = _table().set_index(["group", "condition"]).index

    def stand_in(data, *rest):
        names = zip(data.table["group"], data.table["condition"], strict=True)
        rows = place.get_indexer([*names])
        return jax.tree.map(lambda x: x[rows], moments())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_problem, "all_moments", stand_in)
        if target is not None:
            patch.setattr(_problem, "vote_target", lambda votes, counted: target)
        return fit.fit(data, **{"start": START, **options})
