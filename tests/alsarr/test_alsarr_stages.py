"""Work is done once, again if something changed, and survives an interruption."""

import json
import subprocess
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from alsarr._stages import digest, Stages
from alsarr.tables import TablesJindal2021


class Job:
    """Two stages; each writes a file and counts how often it was asked to."""

    def __init__(self, folder):
        self.folder = folder
        self.calls = []
        self.fail = set()

    def stage(self, stages, name, inputs, files):
        def compute():
            self.calls.append(name)
            if name in self.fail:
                raise RuntimeError("interrupted")
            for file in files:
                (self.folder / file).write_text(f"{name} {inputs}")
            return {"found": [1.5, None], "inputs": repr(inputs)}

        return stages.run(name, inputs, files, compute)

    def __call__(self, first=(1, "a"), second=(2,), files=("two.txt",)):
        """What was computed, in a new process as far as the stages can tell."""
        before = len(self.calls)
        stages = Stages(self.folder)
        one = self.stage(stages, "one", first, ["one.txt"])
        two = self.stage(stages, "two", second, list(files))
        assert [one[1], two[1]] == [n in self.calls[before:] for n in ("one", "two")]
        assert one[0] == {"found": [1.5, None], "inputs": repr(first)}
        return self.calls[before:]


@pytest.fixture
def job(tmp_path):
    job = Job(tmp_path)
    assert job() == ["one", "two"]
    return job


def test_nothing_is_done_twice(job):
    record = (job.folder / "run.json").read_bytes()
    assert job() == job() == []
    assert (job.folder / "run.json").read_bytes() == record


def test_within_one_process_too(tmp_path):
    job, stages = Job(tmp_path), Stages(tmp_path)
    assert job.stage(stages, "one", (1,), ["one.txt"])[1]
    assert not job.stage(stages, "one", (1,), ["one.txt"])[1]
    assert job.stage(stages, "one", (2,), ["one.txt"])[1]


def test_a_changed_input_redoes_its_stage_alone(job):
    assert job(second=(3,)) == ["two"]
    assert job(second=(3,)) == []
    assert job(first=(1, "b"), second=(3,)) == ["one"]
    # Only the latest inputs are remembered.
    assert job() == ["one", "two"]


@pytest.mark.parametrize("damage", ["changed", "gone", "a folder"])
def test_a_file_that_is_not_what_was_made(job, damage):
    path = job.folder / "two.txt"
    path.unlink()
    if damage == "changed":
        path.write_text("two (2,) ")
    elif damage == "a folder":
        path.mkdir()
        with pytest.raises(IsADirectoryError):
            job()
        path.rmdir()
    assert job() == ["two"]
    assert path.read_text() == "two (2,)"
    assert job() == []


def test_another_list_of_files(job):
    assert job(files=("two.txt", "more.txt")) == ["two"]
    assert job(files=("more.txt", "two.txt")) == []
    assert job(files=("more.txt",)) == ["two"]


def test_an_interruption_keeps_what_was_done_before(tmp_path):
    job = Job(tmp_path)
    job.fail = {"two"}
    with pytest.raises(RuntimeError, match="interrupted"):
        job()
    assert job.calls == ["one", "two"]
    job.fail = set()
    assert job() == ["two"]


def test_an_interruption_of_a_redone_stage(job):
    """The file of the last run is still there, but belongs to other inputs."""
    job.fail = {"two"}
    with pytest.raises(RuntimeError):
        job(second=(3,))
    job.fail = set()
    assert job(second=(3,)) == ["two"]
    assert (job.folder / "two.txt").read_text() == "two (3,)"


def test_a_stage_that_does_not_write_its_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        Stages(tmp_path).run("one", [1], ["one.txt"], lambda: {})
    assert not (tmp_path / "run.json").exists()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"\xff\xfe\x00",
        b"[]",
        b"null",
        b"3",
        b'{"one": 3, "two": []}',
        b'{"one": null, "two": {}}',
        b'{"one": {"inputs": "x"}, "two": {"inputs": "y"}}',
    ],
)
def test_a_damaged_record_costs_the_work_only(job, content):
    (job.folder / "run.json").write_bytes(content)
    assert job() == ["one", "two"]
    assert job() == []


@pytest.mark.parametrize("lost", ["files", "result", "inputs"])
def test_a_record_without_one_of_its_entries(job, lost):
    record = json.loads((job.folder / "run.json").read_text())
    del record["two"][lost]
    (job.folder / "run.json").write_text(json.dumps(record))
    assert "two" in job()
    assert job() == []


def test_a_record_whose_entries_have_other_types(job):
    record = json.loads((job.folder / "run.json").read_text())
    record["two"]["files"] = list(record["two"]["files"])
    (job.folder / "run.json").write_text(json.dumps(record))
    assert "two" in job()
    assert job() == []


def test_the_record_is_written_whole(job):
    assert sorted(path.name for path in job.folder.iterdir()) == [
        "one.txt",
        "run.json",
        "two.txt",
    ]
    assert set(json.loads((job.folder / "run.json").read_text())) == {"one", "two"}


# ---- what tells inputs apart


class Tree(eqx.Module):
    x: jnp.ndarray
    name: str = eqx.field(static=True)


TABLE = pd.DataFrame({"a": [1, 2], "b": [0.1, 0.2]})

DIFFERENT = [
    (1, 2),
    (1, 1.0),
    (1.0, float(np.nextafter(1.0, 2.0))),
    (0.0, -0.0),
    (True, 1),
    ("a", "b"),
    ("a", "a "),
    ("1", 1),
    ((1, 2), (2, 1)),
    ((1, 2), (1, 2, 2)),
    (("ab", "c"), ("a", "bc")),
    ((1, (2, 3)), ((1, 2), 3)),
    ([1, 2], (1, 2)),
    ({"a": 1}, {"b": 1}),
    ({"a": 1}, {"a": 2}),
    (None, ()),
    (np.arange(6), np.arange(6).reshape(2, 3)),
    (np.arange(6).reshape(2, 3), np.arange(6).reshape(3, 2)),
    (np.arange(6), np.arange(6.0)),
    (np.arange(6, dtype=np.int32), np.arange(6, dtype=np.int64)),
    (np.zeros(2, np.float32), np.zeros(1, np.float64)),
    (np.zeros(0), np.zeros((0, 3))),
    (np.array([1, 2]), np.array([2, 1])),
    (np.arange(6).reshape(2, 3), np.arange(6).reshape(3, 2).T.reshape(2, 3)),
    (TABLE, TABLE.assign(b=[0.1, np.nextafter(0.2, 1)])),
    (TABLE, TABLE.rename(columns={"b": "c"})),
    (TABLE, TABLE[["b", "a"]]),
    (TABLE, TABLE.iloc[::-1]),
    (TABLE, TABLE.iloc[:1]),
    (Tree(jnp.ones(2), "a"), Tree(jnp.ones(2), "b")),
    (Tree(jnp.ones(2), "a"), Tree(jnp.ones(2).at[1].set(3), "a")),
    (
        TablesJindal2021(np.zeros((2, 12, 2, 10)), ("a", "b")),
        TablesJindal2021(np.zeros((2, 12, 2, 10)), ("a", "c")),
    ),
]


@pytest.mark.parametrize("one, other", DIFFERENT)
def test_digests_differ(one, other):
    assert digest(one) != digest(other)


def test_number_and_order_of_the_parts_count():
    seen = [digest(), digest(1), digest(1, 2), digest(2, 1), digest((1, 2))]
    assert len(set(seen)) == len(seen)
    assert digest(TABLE, TABLE) != digest(TABLE)


def test_equal_inputs_have_equal_digests():
    grid = np.arange(6).reshape(2, 3)
    # Neither memory order, nor the order of keys, nor the index of a table matters.
    assert digest(grid) == digest(np.asfortranarray(grid))
    assert digest(jnp.ones(3)) == digest(np.asarray(jnp.ones(3)))
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest(TABLE) == digest(TABLE.copy()) == digest(TABLE.set_index([[7, 9]]))
    assert digest(Tree(jnp.ones(2), "a")) == digest(Tree(jnp.ones(2), "a"))


@pytest.mark.float64  # other processes, which take no notice of the precision here
def test_another_process_has_the_same_digests():
    code = """
import numpy as np
from alsarr import procedural_frame
from alsarr._stages import digest
from alsarr.tables import TablesJindal2021
tables = TablesJindal2021(np.arange(480.0).reshape(2, 12, 2, 10), ("a", "b"))
frame = procedural_frame(2, rows=3, columns=4, seed=1)
print(digest(("a", 1.5), {"x": np.arange(3.0)}, tables, frame))
"""
    run = lambda: (
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        ).stdout
    )
    first = run()
    assert len(first.strip()) == 64 and run() == first
