"""Reading tidy votes: every problem is reported, with the line it is on."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from camojab import datasets
from camojab._columns import TableError
from camojab.votes import read_votes, scale_groups, votes_denes2020, votes_jindal2021


HEADER = "observer,condition_a,condition_b,a_preferred"


@pytest.fixture
def written(tmp_path):
    def write(text, encoding="utf-8"):
        path = tmp_path / "votes.csv"
        path.write_bytes(text.encode(encoding))
        return path

    return write


def messages(path):
    with pytest.raises(TableError) as caught:
        read_votes(path)
    lines = str(caught.value).splitlines()
    return [line.removeprefix(str(path)) for line in lines], caught.value


def test_a_table_comes_back_as_it_is(written):
    path = written(
        f"\ufeffsession,{HEADER},note,velocity_deg_s\r\n"
        "1, ann ,x,y,1,,10\r\n"
        "\r\n"
        '2,"b,ob",y,z, TRUE ,fine,7.5\r\n'
        "2,bob,y,x,False,n/a,7.5\r\n"
        "2,007,1,2,0,,7.5\r\n"
    )
    table = read_votes(path)
    expected = pd.DataFrame(
        {
            "session": [1, 2, 2, 2],
            "observer": ["ann", "b,ob", "bob", "007"],
            "condition_a": ["x", "y", "y", "1"],
            "condition_b": ["y", "z", "x", "2"],
            "a_preferred": [True, True, False, False],
            "note": ["", "fine", "n/a", ""],
            "velocity_deg_s": [10.0, 7.5, 7.5, 7.5],
        }
    )
    pd.testing.assert_frame_equal(table, expected)


def test_every_problem_is_reported_with_its_line(written):
    path = written(
        f"{HEADER},block\n"
        "ann,x,y,1,PC\n"
        ",x,y,1,PC\n"
        "ann,x,,maybe,PC\n"
        "\n"
        'bob,"x\nx",y,1,PC\n'
        "bob,x,x,0,PC\n"
        "bob,x,y,1\n"
        "bob,x,y,1,PC,PC\n"
        "bob,x,y,2,PC\n"
    )
    found, error = messages(path)
    assert found == [
        ", line 3: `observer` must not be empty.",
        ", line 4: `a_preferred` must be 0, 1, true or false, got 'maybe'.",
        ", line 4: `condition_b` must not be empty.",
        ", line 8: a condition must be compared with another one, got 'x' twice.",
        ", line 9: must have 5 cells, as the header, got 4.",
        ", line 10: must have 5 cells, as the header, got 6.",
        ", line 11: `a_preferred` must be 0, 1, true or false, got '2'.",
    ]
    assert [problem.row for problem in error.problems] == [1, 2, 2, 4, 5, 6, 7]


def test_problems_of_the_header_come_with_those_of_the_rows(written):
    found, error = messages(
        written("observer,condition_a,a_preferred,observer,\nann,,1,ann,\n")
    )
    assert found == [
        ", line 1: every column must have a name, got none for column 5.",
        ", line 1: the table must have each column once, got `observer` again.",
        ", line 1: the table must have the column `condition_b`, got observer, "
        "condition_a, a_preferred, observer, .",
        ", line 2: `condition_a` must not be empty.",
    ]
    assert error.problems == ()


@pytest.mark.parametrize(
    "text, encoding, message",
    [
        ("", "utf-8", ": must begin with the names of the columns."),
        (HEADER, "utf-8", ", line 1: the table must have votes below its header"),
        (f"{HEADER}\nann,x,\xe9,1", "latin-1", ": must be text in UTF-8"),
        (f'{HEADER}\nann,"x"y,z,1', "utf-8", ", line 2: must be CSV"),
    ],
)
def test_files_that_are_no_tables(written, text, encoding, message):
    found, error = messages(written(text, encoding))
    assert len(found) == 1 and found[0].startswith(message)
    assert error.problems == ()


def test_a_missing_file_is_not_a_table_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_votes(tmp_path / "nowhere.csv")


names = st.text("abc xyz019,\"'\u00e9", min_size=1).filter(str.strip).map(str.strip)
rows = st.tuples(names, names, names, st.booleans()).filter(lambda r: r[1] != r[2])


@settings(deadline=None, max_examples=30)
@given(st.lists(rows, min_size=1, max_size=8))
def test_what_is_written_is_read(tmp_path_factory, rows):
    table = pd.DataFrame(rows, columns=HEADER.split(","))
    path = tmp_path_factory.mktemp("votes") / "votes.csv"
    table.to_csv(path, index=False)
    pd.testing.assert_frame_equal(read_votes(path), table, check_dtype=False)


# ---- tables that were not read from a file


def table(**columns):
    whole = {
        "observer": ["ann", "bob"],
        "condition_a": ["x", "x"],
        "condition_b": ["y", "y"],
        "a_preferred": [True, False],
        "block": ["PC", "PC"],
    }
    return pd.DataFrame(whole | columns)


@pytest.mark.parametrize(
    "columns, message",
    [
        ({"observer": ["ann", None]}, "row 1: `observer` must not be empty"),
        ({"block": [np.nan, "PC"]}, "row 0: `block` must not be empty"),
        ({"block": pd.array([1, None], dtype="Int64")}, "row 1: `block` must not"),
        ({"a_preferred": [True, 2]}, "row 1: `a_preferred` must .* got 2"),
        ({"a_preferred": ["yes", "1"]}, "row 0: `a_preferred` must .* got 'yes'"),
        ({"condition_b": ["y", "x"]}, "row 1: a condition must be compared with"),
    ],
)
def test_rows_that_are_no_votes_are_named(columns, message):
    with pytest.raises(TableError, match=message):
        scale_groups(table(**columns), by=["block"])


def test_all_rows_that_are_no_votes_are_named():
    with pytest.raises(TableError) as caught:
        scale_groups(table(observer=["", " "]))
    assert [problem.row for problem in caught.value.problems] == [0, 1]
    assert len(str(caught.value).splitlines()) == 2


def test_columns_that_are_missing_are_named():
    with pytest.raises(TableError, match="column `observer`, got condition_a"):
        scale_groups(table().drop(columns="observer"))
    with pytest.raises(TableError, match="column `scene`"):
        scale_groups(table(), by=["scene"])


def test_columns_of_the_result_do_not_tell_groups_apart():
    with pytest.raises(TableError, match="must not have the column `votes`, which is"):
        scale_groups(table(votes=[1, 2]), by=["votes"])
    with pytest.raises(TableError, match="each column once, got `block` twice"):
        scale_groups(table(), by=["block", "block"])


def test_no_votes_at_all():
    with pytest.raises(TableError, match="at least one row, got none"):
        scale_groups(table().iloc[:0])


# ---- published votes


VOTES = "jindal2021/Experiment_Data/vrs_exp_data.csv"
MATRICES = "denes2020/data/pairwise_comparison_matrices.mat"


def test_jindal(real_data):
    real_data(VOTES)
    votes = votes_jindal2021()
    assert len(votes) == 4764 and votes["observer"].nunique() == 13
    groups = votes.groupby(["block", "velocity_deg_s"])
    assert groups.ngroups == 9
    for _, group in groups:
        conditions = {*group["condition_a"], *group["condition_b"]}
        assert len(conditions) == 9 and {"full", "grass 2x1"} <= conditions
    assert (votes["condition_a"] != votes["condition_b"]).all()
    raw = datasets.jindal2021_votes()
    full = votes["condition_a"] == "full"
    np.testing.assert_array_equal(full, raw["rate_x_a"] == 1)
    # People prefer full rate, whichever side it is on, by 65 % only: motion blurs away
    # most of what coarse shading takes.
    preferred = full == votes["a_preferred"]
    compared = full | (votes["condition_b"] == "full")
    shares = preferred[compared].groupby(full).mean()
    np.testing.assert_allclose(shares, [324 / 489, 327 / 505])
    pc = votes[compared & (votes["block"] == "PC")]
    share = preferred[pc.index].groupby(pc["velocity_deg_s"]).mean()
    np.testing.assert_allclose(share, [0.895, 0.741, 0.550], atol=1e-3)


def test_denes(real_data):
    real_data(MATRICES)
    votes, counts = votes_denes2020(), datasets.denes2020_exp1_comparisons()
    assert len(votes) == counts[["a_wins", "b_wins"]].sum().sum() == 3961
    assert set(votes["observer"]) == {"unknown"}
    pair = ["stimulus", "condition_a", "condition_b"]
    won = votes.groupby(pair)["a_preferred"].agg(["sum", "size"])
    for row in counts.itertuples():
        a, b = (f"{f:g} Hz" for f in (row.refresh_rate_a_hz, row.refresh_rate_b_hz))
        assert tuple(won.loc[(row.stimulus, a, b)]) == (
            row.a_wins,
            row.a_wins + row.b_wins,
        )
