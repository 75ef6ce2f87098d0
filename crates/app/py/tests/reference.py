"""The page of the package, from its docstrings: python tests/reference.py > docs/reference/python.md, with the package installed."""

import inspect
import re
import textwrap

import splatweaver

HEAD = """# Python

Every function and class of the package `splatweaver`; generated from docstrings by `crates/app/py/tests/reference.py`. [The guide](../python.md)
begins with what to type. Further flags of commands are on [the page of flags](flags.md).
"""
FUNCTIONS = ["rasterization", "cameras", "reconstruct", "fit", "infer", "lift", "compress", "open_run", "formats"]
CLASSES = ["Scene", "Camera", "Cameras", "Run"]
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
        section = re.fullmatch(r"(Args|Returns|Raises):", line)
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


def members(cls):
    """The public methods and properties of a class, in its order."""
    for name, item in vars(cls).items():
        if not name.startswith("_") and not isinstance(item, str):
            yield name, item


def class_section(name):
    cls = getattr(splatweaver, name)
    yield f"## {name}\n"
    if name not in ("Run",):
        yield signature(name, cls.__init__)
    yield prose(cls.__doc__)
    rows = []
    for member, item in members(cls):
        if isinstance(item, property):
            rows.append(f"| `.{member}` | {' '.join(inspect.cleandoc(item.__doc__).split())} |")
    yield "\n".join(["| property | |", "|---|---|", *rows]) + "\n"
    for member, item in members(cls):
        if not isinstance(item, property):
            function = getattr(cls, member)
            yield f"### {name}.{member}\n"
            yield signature(f"{name if isinstance(item, classmethod) else name.lower()}.{member}", function)
            yield prose(function.__doc__)


def page():
    parts = [HEAD]
    for name in FUNCTIONS:
        item = getattr(splatweaver, name)
        parts += [f"## {name}\n", signature(name, item), prose(item.__doc__)]
    parts += ["## set_threads\n", "```python\nset_threads(count)\n```\n", prose(splatweaver.set_threads.__doc__)]
    for name in CLASSES:
        parts += class_section(name)
    parts += ["## Meta\n", prose(splatweaver.Meta.__doc__)]
    fields = ", ".join(f"`{field}`" for field in splatweaver.Progress._fields)
    parts += ["## Progress\n", prose(splatweaver.Progress.__doc__), f"Fields: {fields}.\n"]
    rows = [f"| `{name}` | {' '.join(getattr(splatweaver, name).__doc__.split())} |" for name in ERRORS]
    parts += ["## Errors\n", "\n".join(["| exception | |", "|---|---|", *rows]) + "\n"]
    return "\n".join(parts).rstrip("\n").replace("\n\n\n", "\n\n") + "\n"


if __name__ == "__main__":
    print(page(), end="")
