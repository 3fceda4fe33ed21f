"""Every Python block of the pages runs, and what the pages link to is there."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import alsarr.cli
import camojab.cli
from camojab import (
    Components,
    datasets,
    Display,
    Formulation,
    quality,
    Spectrum,
    Viewing,
)


ROOT = Path(__file__).parents[1]
PROGRAMS = {"camojab": camojab.cli.app, "alsarr": alsarr.cli.app}

# They run in processes of their own, which know nothing of the lane.
pytestmark = pytest.mark.float64


def _blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)


DOCUMENTS = {
    "README.md": _blocks(ROOT / "README.md"),
    **{
        f"notebooks/{name}.md": _blocks(ROOT / "notebooks" / f"{name}.md")
        for name in ("precision", "controller", "network", "votes", "tables", "engine")
    },
}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_document_runs(name, tmp_path):
    source = "\n".join(DOCUMENTS[name])
    assert source.strip()
    environment = {**os.environ, "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", source],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


PAGES = [
    "README.md",
    "CHANGELOG.md",
    *(f"data/{path.name}" for path in sorted((ROOT / "data").glob("*.md"))),
    *(f"notebooks/{path.name}" for path in sorted((ROOT / "notebooks").glob("*.md"))),
]


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_somewhere(name):
    page = ROOT / name
    links = re.findall(r"\]\(([^)#]+)(#[^)]*)?\)", page.read_text())
    missing = [
        link
        for link, _ in links
        if not link.startswith("https:") and not (page.parent / link).exists()
    ]
    assert missing == []
    anchors = (ROOT / "notebooks" / "reference.md").read_text()
    for link, anchor in links:
        if link.endswith("reference.md") and anchor:
            assert f'<a id="{anchor[1:]}"></a>' in anchors


def _commands(name):
    """Command lines of the shell blocks, with their own comments left out."""
    text = (ROOT / name).read_text()
    for block in re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if words and words[0] in PROGRAMS:
                yield words


@pytest.mark.parametrize("name", DOCUMENTS)
def test_commands_have_the_options_that_pages_say(name):
    for program, *words in _commands(name):
        command = typer.main.get_command(PROGRAMS[program]).commands[words.pop(0)]
        if words[0] in getattr(command, "commands", ()):
            command = command.commands[words.pop(0)]
        known = {option for p in command.params for option in p.opts}
        used = {word for word in words if word.startswith("-")}
        assert used <= known


def test_what_the_page_says_of_0_jnd_is_so():
    page = (ROOT / "notebooks" / "differences.md").read_text()
    rows = re.findall(
        r"\| (\w+), (\S+) \| (\S+) JND \| (\S+) JND \| (\S+) JND \|", page
    )
    assert len(rows) == 4
    textures = datasets.builtin_textures()
    for name, persistence, *expected in rows:
        spectrum = Spectrum.from_texture(textures[name])
        display = Display(
            ppd=60, refresh_rate=60, luminance=100, persistence=float(persistence)
        )
        found = [
            quality(spectrum, display, Viewing(0.0), **options)
            for options in (
                {"components": Components(vrs=False)},
                {"formulation": Formulation.RELEASED},
                {"formulation": Formulation.PAPER},
            )
        ]
        assert [f"{float(each):.2f}" for each in found] == [
            text.lstrip("+") for text in expected
        ]
