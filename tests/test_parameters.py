import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab import Formulation, load_parameters, Parameters, save_parameters


VALUES = {"ws": -3.7, "wt": -2.9, "beta": 0.36, "ca": 0.0016, "cb": 0.08}


def test_published_constants_of_the_released_program():
    # camojab_fits.mat of gfxdisp/ALSaRR at d06b3e0; ca and cb of Denes et al. 2020,
    # Table 1.
    published = {
        "ws": -3.69853094,
        "wt": -2.90681934,
        "beta": 0.35966351,
        "ca": 0.001648,
        "cb": 0.079818,
    }
    ours = Parameters.published()
    for name, value in published.items():
        np.testing.assert_allclose(getattr(ours, name), value, rtol=1e-7)
    # Table 4 of Jindal et al. 2021 prints two decimals of them.
    assert (round(float(ours.ws), 2), round(float(ours.wt), 2)) == (-3.7, -2.91)


@pytest.mark.parametrize("formulation", list(Formulation))
def test_every_formulation_has_its_constants(formulation):
    ours = Parameters.published(formulation)
    assert ours.ws < 0 and ours.wt < 0 and 0 < ours.beta < 1
    assert {x.shape for x in jax.tree.leaves(ours)} == {()}


def test_the_formulations_have_constants_of_their_own():
    released, paper = map(Parameters.published, Formulation)
    assert released.ws != paper.ws and released.beta != paper.beta


def test_defaults_of_the_eye_blur():
    ours = Parameters(ws=1, wt=1, beta=1)
    np.testing.assert_allclose([ours.ca, ours.cb], [0.001648, 0.079818], rtol=1e-6)


# ---- files


@pytest.mark.parametrize("formulation", list(Formulation))
def test_round_trip_keeps_every_bit(tmp_path, formulation):
    random = np.random.default_rng(0)
    draw = lambda: jnp.asarray(float(random.lognormal(-2)), float)
    ours = Parameters(ws=-draw(), wt=-draw(), beta=draw(), ca=draw(), cb=draw())
    path = tmp_path / "new" / "parameters.json"
    save_parameters(path, ours, formulation, provenance="a test")
    loaded, of = load_parameters(path)
    assert of is formulation
    for name in VALUES:
        a, b = getattr(ours, name), getattr(loaded, name)
        assert a.dtype == b.dtype and a == b


def test_file_says_what_it_holds(tmp_path):
    path = tmp_path / "parameters.json"
    save_parameters(
        path,
        Parameters(**VALUES),
        Formulation.PAPER,
        provenance="a test",
        details={"rmse_jnd": 0.5},
    )
    document = json.loads(path.read_text())
    assert document["schema"] == "camojab-parameters/1"
    assert document["formulation"] == "paper"
    assert document["units"] == {
        "ws": "JND",
        "wt": "JND",
        "beta": "1",
        "ca": "s",
        "cb": "deg",
    }
    assert document["provenance"] == "a test" and document["rmse_jnd"] == 0.5
    load_parameters(path)


def test_details_do_not_replace_what_the_file_must_hold(tmp_path):
    path = tmp_path / "parameters.json"
    own = {"parameters": {"ws": 1.0, "wt": 1.0, "beta": 1.0}, "formulation": "paper"}
    try:
        save_parameters(
            path,
            Parameters(**VALUES),
            Formulation.RELEASED,
            provenance="a test",
            details=own,
        )
    except ValueError:
        assert not path.exists()
    else:
        loaded, formulation = load_parameters(path)
        assert formulation is Formulation.RELEASED
        np.testing.assert_allclose(loaded.ws, VALUES["ws"], rtol=1e-6)


GOOD = {"formulation": "released", "parameters": VALUES}
without = lambda name: {k: v for k, v in VALUES.items() if k != name}
WRONG = {
    "not json": "ws = -3.7",
    "empty": "",
    "truncated": json.dumps(GOOD)[:-9],
    "a list": "[1, 2]",
    "a number": "3",
    "null": "null",
    "no parameters": json.dumps({"formulation": "released"}),
    "no formulation": json.dumps({"parameters": VALUES}),
    "parameters are a list": json.dumps(GOOD | {"parameters": [1]}),
    "unknown formulation": json.dumps(GOOD | {"formulation": "draft"}),
    "unknown parameter": json.dumps(GOOD | {"parameters": VALUES | {"gamma": 1}}),
    "missing ws": json.dumps(GOOD | {"parameters": without("ws")}),
    "missing beta": json.dumps(GOOD | {"parameters": without("beta")}),
    "text": json.dumps(GOOD | {"parameters": VALUES | {"ws": "low"}}),
    "a null": json.dumps(GOOD | {"parameters": VALUES | {"ws": None}}),
    "nan": json.dumps(GOOD | {"parameters": VALUES | {"ws": float("nan")}}),
    "negative beta": json.dumps(GOOD | {"parameters": VALUES | {"beta": -1}}),
}


@pytest.mark.parametrize("text", WRONG.values(), ids=WRONG.keys())
def test_wrong_files_are_named(tmp_path, text):
    path = tmp_path / "wrong.json"
    path.write_text(text)
    with pytest.raises(ValueError) as error:
        load_parameters(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ") and message.endswith(".")
    assert "\n" not in message


@pytest.mark.parametrize(
    "wrong, named",
    [
        ("no parameters", "parameters"),
        ("no formulation", "formulation"),
        ("unknown formulation", "draft"),
        ("unknown parameter", "gamma"),
        ("missing ws", "ws"),
        ("missing beta", "beta"),
        ("text", "ws"),
        ("a null", "ws"),
        ("nan", "ws"),
        ("negative beta", "beta"),
    ],
)
def test_wrong_entries_are_named(tmp_path, wrong, named):
    path = tmp_path / "file.json"
    path.write_text(WRONG[wrong])
    with pytest.raises(ValueError) as error:
        load_parameters(path)
    message = str(error.value).removeprefix(f"{path}: ")
    assert named in message
    # A reader of the file need not know how the package is written.
    assert "__init__" not in message and "float()" not in message


def test_binary_file_is_named(tmp_path):
    path = tmp_path / "wrong.json"
    path.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ValueError, match="wrong.json: "):
        load_parameters(path)


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere.json"):
        load_parameters(tmp_path / "nowhere.json")


def test_report_is_one_line():
    line = Parameters(ws=-3.5, wt=-2.25, beta=0.375, ca=0, cb=0.5).report()
    assert line == "ws=-3.5, wt=-2.25, beta=0.375, ca=0, cb=0.5"


def test_report_of_many_is_one_line():
    line = Parameters(ws=np.array([-3.5, -1.0]), wt=-2.25, beta=0.375).report()
    assert "ws=-3.5..-1" in line and "\n" not in line
