"""A fit as a file: what it must say, read back, and whose data it was."""

import functools
import json
from importlib.metadata import version

import jax
import numpy as np
import pytest

import invented
from camojab import fit, Formulation, load_parameters
from camojab.fit._file import checksums


X64 = jax.config.jax_enable_x64
KEYS = {
    "schema",
    "formulation",
    "parameters",
    "units",
    "provenance",
    "free",
    "values",
    "value_units",
    "standard_error",
    "covariance",
    "correlation",
    "scales",
    "lapse",
    "rmse_jnd",
    "log_likelihood",
    "aic",
    "bic",
    "data",
    "solver",
    "steps",
    "converged",
    "result",
    "seed",
    "versions",
}


@functools.cache
def found():
    return invented.fitted(invented.observations(noise=0.2))


@pytest.fixture
def document(tmp_path):
    path = tmp_path / "new" / "fit.json"
    fit.save_fit(
        path, found(), provenance="a test", seed=7, details={"note": "hand-made"}
    )
    return path, json.loads(path.read_text())


def test_file_has_everything(document):
    _, written = document
    assert set(written) == KEYS | {"note"}
    assert written["provenance"] == "a test" and written["note"] == "hand-made"
    assert written["seed"] == 7 and written["formulation"] == "released"
    names = ["ws", "wt", "beta", "scale:refresh", "scale:judder"]
    assert written["free"] == names
    assert list(written["values"].values()) == found().values.tolist()
    assert written["value_units"] == dict(
        zip(names, ["JND", "JND", "1", "1", "1"], strict=True)
    )
    np.testing.assert_array_equal(
        list(written["standard_error"].values()), found().standard_error
    )
    np.testing.assert_array_equal(written["covariance"], found().covariance)
    np.testing.assert_array_equal(written["correlation"], found().correlation)
    assert written["scales"] == found().scales and written["lapse"] == 0
    assert written["rmse_jnd"] == {**found().rmse, "all": found().total_rmse}
    for key in ("log_likelihood", "aic", "bic", "steps", "converged"):
        assert written[key] == getattr(found(), key)
    assert written["result"] == found().verdict
    assert written["solver"] == "levenberg-marquardt"
    assert written["versions"]["jax"] == version("jax")
    assert written["data"]["kind"] == "JND" and written["data"]["size"] == 18


def test_parameters_are_read_back(document):
    path, _ = document
    loaded, formulation = load_parameters(path)
    assert formulation is Formulation.RELEASED
    for ours, theirs in zip(
        jax.tree.leaves(found().parameters), jax.tree.leaves(loaded), strict=True
    ):
        assert ours == theirs


def test_what_is_not_a_number_is_null(tmp_path):
    """A fit to votes that cannot be scaled has no errors in JND."""
    given = invented.comparisons(observers=3)
    # Votes on the judder leave one of its conditions out.
    kept = ~((given.votes["group"] == "judder") & (given.votes["b"] == 21))
    part = fit.Comparisons(given.table, given.votes[kept], given.textures)
    # Single precision stops where its digits end; the file does not depend on it.
    voted = invented.fitted(part, free=("ws", "wt"))
    described = fit.describe(voted)
    assert described["data"]["kind"] == "votes"
    assert described["data"]["size"] == kept.sum()
    assert described["rmse_jnd"] == {} and np.isnan(voted.total_rmse)
    assert set(described["data"]["sha256"]) == {
        "table",
        "votes",
        "texture brick",
        "texture grass",
    }
    path = tmp_path / "fit.json"
    fit.save_fit(path, voted, provenance="a test")
    text = path.read_text()
    assert "NaN" not in text and json.loads(text)["seed"] is None


def test_same_data_same_checksums():
    one, other = (checksums(invented.observations()) for _ in range(2))
    assert one == other and all(len(digest) == 64 for digest in one.values())
    shuffled = invented.observations()
    columns = shuffled.table[sorted(shuffled.table)[::-1]]
    assert checksums(fit.Observations(columns, shuffled.textures)) == one


def test_other_data_other_checksums():
    given = invented.comparisons()
    usual = checksums(given)
    texels = given.textures["brick"].copy()
    texels[1, 2] = np.nextafter(texels[1, 2], 1)
    changed = {**given.textures, "brick": texels}
    different = lambda a: {name for name in usual if a[name] != usual[name]}
    brick = fit.Comparisons(given.table, given.votes, changed)
    assert different(checksums(brick)) == {"texture brick"}
    # The same numbers in another shape are another texture.
    turned = {**given.textures, "brick": given.textures["brick"].T}
    turned = fit.Comparisons(given.table, given.votes, turned)
    assert different(checksums(turned)) == {"texture brick"}
    votes = given.votes.copy()
    votes.loc[5, "a_preferred"] ^= True
    recast = fit.Comparisons(given.table, votes, given.textures)
    assert different(checksums(recast)) == {"votes"}
    table = given.table.copy()
    table.loc[2, "refresh_rate_hz"] = np.nextafter(table.loc[2, "refresh_rate_hz"], 0)
    moved = fit.Comparisons(table, given.votes, given.textures)
    assert different(checksums(moved)) == {"table"}
