"""The pages of the package, from its docstrings: python crates/app/py/tests/reference.py, with the package installed."""

import inspect
import re
import textwrap
from pathlib import Path

import splatweaver

#: Where the pages are.
FOLDER = Path(__file__).parents[4] / "docs/reference/python"
HEAD = """# Python

The package `splatweaver`, a page for each function and class; generated from docstrings by `crates/app/py/tests/reference.py`.
[The guide](../../guide/python.md) begins with examples. Further flags of commands are on [the page of flags](../flags.md).
"""
FUNCTIONS = ["rasterization", "cameras", "reconstruct", "fit", "infer", "lift", "compress", "open_run", "formats", "set_threads"]
CLASSES = ["Scene", "Camera", "Cameras", "Run", "Meta", "Progress"]
ERRORS = ["Error", "InputError", "FileError", "MemoryPlanError", "NumericError"]


def signature(name, item):
    """The call, with its parameters and their defaults, without types."""
    parts, keyword = [], False
    for parameter in inspect.signature(item).parameters.values():
        if parameter.name == "self":
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not keyword:
            keyword = True
            parts.append("*")
        star = "**" if parameter.kind is parameter.VAR_KEYWORD else "*" if parameter.kind is parameter.VAR_POSITIONAL else ""
        default = "" if parameter.default is parameter.empty else f"={parameter.default!r}"
        keyword = keyword or star == "*"
        parts.append(f"{star}{parameter.name}{default}")
    line = f"{name}({', '.join(parts)})"
    return "```python\n" + "\n".join(textwrap.wrap(line, 120, subsequent_indent="    ", break_long_words=False)) + "\n```\n"


def prose(docstring):
    """A docstring in Markdown: arguments as a table, examples in fences."""
    out, table = [], False
    text = inspect.cleandoc(docstring or "")
    for line in text.split("\n"):
        section = re.fullmatch(r"(Args|Fields|Returns|Raises):", line)
        if section:
            table = section[1] != "Returns"
            out += [f"**{section[1].replace('Args', 'Arguments')}**", ""] + (["| | |", "|---|---|"] if table else [])
        elif table and (entry := re.fullmatch(r"    (\*{0,2}\w+): (.*)", line)):
            out.append(f"| `{entry[1]}` | {entry[2].replace('|', chr(92) + '|')} |")
        elif table and line.startswith("     ") and out[-1].endswith(" |"):
            out[-1] = f"{out[-1][:-2]} {line.strip()} |"
        else:
            table = table and not line.strip() == ""
            out.append(line[4:] if line.startswith("    ") and not line.lstrip().startswith("...") else line)
    text = "\n".join(out)
    return re.sub(r"(?ms)^>>> .*?(?=\n\n|\Z)", lambda m: f"```python\n{m[0]}\n```", text) + "\n"


def one_line(item):
    return " ".join(inspect.cleandoc(item.__doc__).split())


def members(cls, kind):
    """Names of the public properties or methods of a class, in its order."""
    for name, item in vars(cls).items():
        known = isinstance(item, (property, classmethod, staticmethod)) or inspect.isfunction(item)
        if known and not name.startswith("_") and isinstance(item, property) == (kind is property):
            yield name


def function_page(name):
    item = getattr(splatweaver, name)
    flags = f"[The other flags](../flags.md#{name}) of the command"
    return [f"# {name}\n", signature(name, item), prose(item.__doc__).replace("The other flags of the command", flags)]


def class_page(name):
    cls = getattr(splatweaver, name)
    parts = [f"# {name}\n"]
    # Of the others, instances are given.
    if name in ("Scene", "Camera", "Cameras"):
        parts.append(signature(name, cls.__init__))
    parts.append(prose(cls.__doc__))
    rows = [f"| `.{member}` | {one_line(getattr(cls, member))} |" for member in members(cls, property)]
    if rows:
        parts.append("\n".join(["| property | |", "|---|---|", *rows]) + "\n")
    for member in members(cls, "method"):
        function = getattr(cls, member)
        of_class = isinstance(vars(cls)[member], classmethod)
        call = signature(f"{name if of_class else name.lower()}.{member}", function)
        parts += [f"## {name}.{member}\n", call, prose(function.__doc__)]
    return parts


def index():
    rows = []
    for name, file in [(name, f"{name}.md") for name in FUNCTIONS] + [(name, class_file(name)) for name in CLASSES]:
        first = inspect.cleandoc(getattr(splatweaver, name).__doc__).split("\n\n")[0]
        rows.append(f"| [`{name}`]({file}) | {' '.join(first.split())} |")
    errors = [f"| `{name}` | {one_line(getattr(splatweaver, name))} |" for name in ERRORS]
    table = "\n".join
    return [HEAD, table(["| | |", "|---|---|", *rows]) + "\n", "## Errors\n", table(["| exception | |", "|---|---|", *errors]) + "\n"]


def class_file(name):
    # Some file systems take Cameras.md and cameras.md for one.
    return f"class-{name.lower()}.md"


def pages():
    """The text of each page by the name of its file."""
    found = {"README.md": index()}
    found.update({f"{name}.md": function_page(name) for name in FUNCTIONS})
    found.update({class_file(name): class_page(name) for name in CLASSES})
    return {file: "\n".join(parts).rstrip("\n").replace("\n\n\n", "\n\n") + "\n" for file, parts in found.items()}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for file in FOLDER.glob("*.md"):
        file.unlink()
    for file, text in pages().items():
        (FOLDER / file).write_text(text, encoding="utf-8")
