import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab import Formulation, load_parameters, Parameters, save_parameters
from camojab._parameters import FACTORS


VALUES = {
    "ws": -3.7,
    "wt": -2.9,
    "beta": 0.36,
    "ca": 0.0016,
    "cb": 0.08,
    "mipmap_width": 1.1,
    "hold_width": 0.9,
    "pursuit_width": 1.2,
    "achromatic_gain": 0.8,
    "red_green_gain": 1.3,
    "yellow_violet_gain": 0.7,
    "velocity_gain": 1.05,
}


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


def test_factors_are_one_by_default():
    ours = Parameters(ws=1, wt=1, beta=1)
    assert set(FACTORS) == set(list(VALUES)[5:])
    assert [getattr(ours, name) for name in FACTORS] == [1.0] * 7


@pytest.mark.parametrize("name", list(VALUES)[2:])
@pytest.mark.parametrize("value", [-1.0, 0.0, np.inf, np.nan])
def test_constants_out_of_range_are_named(name, value):
    if name in ("ca", "cb") and value == 0:
        return
    rule = ">= 0" if name in ("ca", "cb") else "> 0"
    with pytest.raises(ValueError, match=rf"`{name}` must be finite, {rule}.*, got"):
        Parameters(**VALUES | {name: value})


# ---- files


@pytest.mark.parametrize("formulation", list(Formulation))
def test_round_trip_keeps_every_bit(tmp_path, formulation):
    random = np.random.default_rng(0)
    draw = lambda: jnp.asarray(float(random.lognormal(-2)), float)
    sign = lambda name: -1 if name in ("ws", "wt") else 1
    ours = Parameters(**{name: sign(name) * draw() for name in VALUES})
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
        **dict.fromkeys(FACTORS, "1"),
    }
    assert document["parameters"] == pytest.approx(VALUES, rel=1e-6)
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
    "no width": json.dumps(GOOD | {"parameters": VALUES | {"hold_width": 0}}),
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
        ("no width", "hold_width"),
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


def test_report_names_the_factors_that_are_not_one():
    line = Parameters(
        ws=-3.5, wt=-2.25, beta=0.375, ca=0, cb=0.5, hold_width=2
    ).report()
    assert line == "ws=-3.5, wt=-2.25, beta=0.375, ca=0, cb=0.5, hold_width=2"


def test_files_from_before_the_factors_are_read(tmp_path):
    path = tmp_path / "file.json"
    few = {name: VALUES[name] for name in list(VALUES)[:5]}
    path.write_text(json.dumps({"formulation": "released", "parameters": few}))
    loaded, _ = load_parameters(path)
    assert loaded.mipmap_width == 1 and loaded.velocity_gain == 1
    np.testing.assert_allclose(loaded.ca, few["ca"], rtol=1e-6)


def test_report_of_many_is_one_line():
    line = Parameters(ws=np.array([-3.5, -1.0]), wt=-2.25, beta=0.375).report()
    assert "ws=-3.5..-1" in line and "\n" not in line
