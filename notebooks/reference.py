"""Write reference.md: every public name, its signature as written and its docstring.

Nothing is imported: griffe reads the sources.
"""

import ast
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import griffe


ROOT = Path(__file__).parents[1]

HEAD = """\
# Reference

Every public name of `camojab` and `alsarr`, from the docstrings; `make reference`
writes this page. A number has its unit in brackets, `[1]` where it has none, and an
array its shape: `Float[Array, " tiles"]` has one axis, `"..."` any that broadcast.
Constructors take what is listed as arguments, or else the fields of the class.
"""


def page() -> str:
    """The whole page."""
    found = [m for name in ("camojab", "alsarr") for m in modules(name)]
    parts = [*map(table_of_contents, found), *map(section, found)]
    return "\n\n".join([f"{HEAD}\n## Contents", *parts, ""]).rstrip() + "\n"


def modules(name: str) -> Iterator[griffe.Module]:
    """The package, then its public sub-packages by name."""
    package = griffe.load(name, search_paths=[ROOT], allow_inspection=False)
    yield package
    for name, member in sorted(package.members.items()):
        if not name.startswith("_") and not member.is_alias and member.is_init_module:
            yield member


def names(module: griffe.Module) -> list[str]:
    """What a module offers: what it imports under its own name, sub-packages apart."""
    public = [n for n, m in module.members.items() if m.is_alias and n[0] != "_"]
    public = [n for n in public if not module[n].final_target.is_module]
    return sorted(public, key=str.lower)


def table_of_contents(module: griffe.Module) -> str:
    lines = [
        f"- [{name}](#{module.path}.{name}): {first_line(module[name])}"
        for name in names(module)
    ]
    heading = f"[`{module.path}`](#{module.path}): {first_line(module)}"
    return "\n".join([f"**{heading}**", "", *lines])


def section(module: griffe.Module) -> str:
    parts = [f'<a id="{module.path}"></a>', f"## {module.path}", docstring(module)]
    for name in names(module):
        item, path = module[name].final_target, f"{module.path}.{name}"
        parts += [f'<a id="{path}"></a>', f"### {path}", code(item), docstring(item)]
        if item.is_class:
            for method in methods(item):
                parts += [f"**`{name}.{method.name}`**", code(method)]
                parts += [docstring(method)]
    return "\n\n".join(part for part in parts if part)


def methods(item: griffe.Class) -> Iterator[griffe.Object]:
    """Its own, and those of bases that are not public."""
    for member in [*item.members.values(), *item.inherited_members.values()]:
        method = member.final_target if member.is_alias else member
        ours = not member.is_alias or method.parent.name.startswith("_")
        called = method.is_function or "property" in method.labels
        if ours and called and not method.name.startswith("_"):
            yield method


def code(item: griffe.Object) -> str:
    """The signature, as it is written in the source, and the fields of a class."""
    source = textwrap.dedent("\n".join(item.lines))
    (node,) = ast.parse(source).body
    kept = lines = source.splitlines()
    if isinstance(node, ast.FunctionDef):
        kept = lines[: node.body[0].lineno - 1]
    elif isinstance(node, ast.ClassDef):
        kept = lines[node.lineno - 1 : node.body[0].lineno - 1]
        for field in filter(is_field, node.body):
            kept += lines[field.lineno - 1 : field.end_lineno]
        for method in node.body:
            if isinstance(method, ast.FunctionDef) and method.name == "__init__":
                kept += ["", *lines[method.lineno - 1 : method.body[0].lineno - 1]]
    return "\n".join(["```python", *kept, "```"])


def is_field(node: ast.stmt) -> bool:
    """A field with a type, or a member of an enumeration."""
    if not isinstance(node, ast.AnnAssign | ast.Assign):
        return False
    target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
    return isinstance(target, ast.Name) and not target.id.startswith("_")


def docstring(item: griffe.Object) -> str:
    """As Markdown, its examples as code."""
    text = item.docstring.value if item.docstring else ""
    fence = r"```python\n\1```\n"
    return re.sub(r"^(>>> (?:.+\n?)+)", fence, f"{text}\n", flags=re.MULTILINE).strip()


def first_line(item: griffe.Object | griffe.Alias) -> str:
    target = item.final_target if item.is_alias else item
    return docstring(target).split("\n\n")[0].replace("\n", " ")


if __name__ == "__main__":
    (ROOT / "notebooks" / "reference.md").write_text(page(), encoding="utf-8")
