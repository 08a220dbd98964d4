"""Writes docs/api.md from the docstrings: ``python docs/api.py``; a test holds the page to it.

The source is read, not imported: compiled modules have no docstrings.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "api.md"
PACKAGES = ("m2c", "moon", "transports")
HEAD = """# The Python interface

What `import m2c`, `import moon` and `import transports` offer. Everything else may change from one
version to the next. Each example runs as a test, in the root of the repository. What each method of a
transport owes is in [`transports/interface.py`](../transports/interface.py) and in
[Writing a transport](transport-authors.md).

This page is written by `python docs/api.py` from the docstrings.
"""
_BLANK = "\n\n"
_SECTIONS = {
    "Args": "Arguments",
    "Attributes": "Attributes",
    "Returns": "Returns",
    "Raises": "Raises",
}
_SECTION = re.compile(rf"^({'|'.join(_SECTIONS)}):$")
_ROLE = re.compile(r":\w+:`~?([^`]+)`")

_IN_FULL = frozenset(
    {
        "Conditions",
        "Call",
        "Client",
        "Connection",
        "Diagnostic",
        "Gap",
        "Judge",
        "Listener",
        "Node",
        "NodeChange",
        "Observation",
        "Publisher",
        "Recording",
        "System",
        "Tap",
        "Transport",
        "Verdict",
        "available",
    }
)
"""What is described in full though it has no arguments; the others are lines of a table."""
_BETWEEN_MODULES: dict[str, frozenset[str]] = {
    "PropertySet": frozenset({"channels", "listen_as", "restore", "snapshot"}),
    "Recording": frozenset({"attribution", "offer", "structure"}),
    "SimulatedWorld": frozenset(
        {"busy_ns", "copies", "enter", "idle", "schedule", "send", "send_to_tap", "spawn", "stamp"}
        | {"step", "wait_for_threads"}
    ),
}
"""Methods that other modules of the package call, and no one else."""

Definition = ast.ClassDef | ast.FunctionDef


def page() -> str:
    """The text of the page."""
    return "\n".join([HEAD, *(line for package in PACKAGES for line in _package(package))])


def names_of(package: str) -> list[str]:
    """``__all__`` of ``package``."""
    for statement in _tree(package).body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "__all__":
            found: list[str] = ast.literal_eval(statement.value)
            return found
    raise ValueError(f"{package} has no __all__")


def _package(package: str) -> Iterator[str]:
    yield f"## `import {package}`\n"
    yield from _prose(ast.get_docstring(_tree(package)) or "")
    rows: list[str] = []
    for name in sorted(names_of(package), key=str.lower):
        definition = _definition(package, name)
        if isinstance(definition, str):
            rows.append(_row(name, definition))
        elif name not in _IN_FULL and not _has_arguments(definition):
            rows.append(_row(name, ast.get_docstring(definition) or ""))
        else:
            yield f"### `{package}.{name}`\n"
            yield from (
                _function(definition, definition.name)
                if isinstance(definition, ast.FunctionDef)
                else _class(definition)
            )
    yield f"### Also in `{package}`\n\n| name | what it is |\n|---|---|"
    yield from rows
    yield ""


def _row(name: str, docstring: str) -> str:
    return f"| `{name}` | {_line(docstring.partition(_BLANK)[0])} |"


def _has_arguments(definition: Definition) -> bool:
    return "\nArgs:\n" in (ast.get_docstring(definition) or "")


def _function(definition: ast.FunctionDef, name: str) -> Iterator[str]:
    yield f"```python\n{_signature(definition, name)}\n```\n"
    yield from _prose(ast.get_docstring(definition) or "")


def _class(definition: ast.ClassDef) -> Iterator[str]:
    methods = [item for item in definition.body if isinstance(item, ast.FunctionDef)]
    if _has_arguments(definition):
        for method in methods:
            if method.name == "__init__":
                yield f"```python\n{_signature(method, definition.name)}\n```\n"
    yield from _prose(ast.get_docstring(definition) or "")
    hidden = _BETWEEN_MODULES.get(definition.name, frozenset())
    shown = [item for item in methods if not item.name.startswith("_") and item.name not in hidden]
    if shown:
        yield "Methods and properties:\n"
        for method in shown:
            first = (ast.get_docstring(method) or "").partition(_BLANK)[0]
            yield f"* `{_call(method)}`: {_line(first)}"
        yield ""


def _call(method: ast.FunctionDef) -> str:
    """How a method is called, without types; a property is named."""
    if any(ast.unparse(decorator) == "property" for decorator in method.decorator_list):
        return method.name
    arguments = [*method.args.posonlyargs, *method.args.args][1:]
    names = [argument.arg for argument in arguments]
    if method.args.vararg:
        names.append(f"*{method.args.vararg.arg}")
    names += [f"{argument.arg}=" for argument in method.args.kwonlyargs]
    return f"{method.name}({', '.join(names)})"


def _signature(function: ast.FunctionDef, name: str) -> str:
    """``name(parameter: type = default, …) -> type``, a parameter a line."""
    arguments = function.args
    parts: list[str] = []
    plain = [argument for argument in arguments.args if argument.arg not in ("self", "cls")]
    missing = len(plain) - len(arguments.defaults)
    defaults = [None] * missing + list(arguments.defaults)
    for argument, default in zip(plain, defaults, strict=True):
        parts.append(_parameter(argument, default))
    if arguments.vararg:
        parts.append(f"*{_parameter(arguments.vararg, None)}")
    elif arguments.kwonlyargs:
        parts.append("*")
    for argument, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
        parts.append(_parameter(argument, default))
    returns = ""
    if function.returns and function.name != "__init__":
        returns = f" -> {ast.unparse(function.returns)}"
    line = f"{name}({', '.join(parts)}){returns}"
    if len(line) <= 90:
        return line
    return "\n".join([f"{name}(", *(f"    {part}," for part in parts), f"){returns}"])


def _parameter(argument: ast.arg, default: ast.expr | None) -> str:
    kind = f": {ast.unparse(argument.annotation)}" if argument.annotation else ""
    return f"{argument.arg}{kind}" + (f" = {ast.unparse(default)}" if default else "")


def _prose(docstring: str) -> Iterator[str]:
    """A docstring as Markdown: sections are lists, examples are code."""
    for block in docstring.split("\n\n"):
        lines = block.splitlines()
        if not lines:
            continue
        if lines[0].startswith(">>>"):
            yield f"```pycon\n{block}\n```\n"
        elif _SECTION.match(lines[0]):
            what = lines[0].removesuffix(":")
            text = inspect.cleandoc("\n".join(lines[1:]))
            if what == "Returns":
                yield f"Returns: {_line(text)}\n"
                continue
            yield f"{_SECTIONS[what]}:\n"
            yield from _items(text.splitlines())
            yield ""
        else:
            yield f"{_inline(block)}\n"


def _items(lines: list[str]) -> Iterator[str]:
    """The entries of a section; a line that goes on is indented."""
    entries: list[str] = []
    for line in lines:
        if entries and line.startswith(" "):
            entries[-1] += f" {line.strip()}"
        else:
            entries.append(line)
    for entry in entries:
        name, _, text = entry.partition(": ")
        yield f"* `{name}`: {_line(text)}"


def _line(text: str) -> str:
    """Text of a docstring in one line of Markdown."""
    return " ".join(_inline(text).split())


def _inline(text: str) -> str:
    return _ROLE.sub(r"`\1`", text).replace("``", "`")


def _definition(module: str, name: str) -> Definition | str:
    """What ``module`` defines or imports as ``name``; of another value, the text below it."""
    body = _tree(module).body
    for place, statement in enumerate(body):
        if isinstance(statement, Definition) and statement.name == name:
            return statement
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == name:
            told = body[place + 1]
            assert isinstance(told, ast.Expr)
            assert isinstance(told.value, ast.Constant)
            return str(told.value.value)
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.ImportFrom) and any(part.name == name for part in node.names):
            return _definition(str(node.module), name)
    raise ValueError(f"{module}.{name} is not defined")


def _tree(module: str) -> ast.Module:
    path = ROOT / module.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(file.read_text(encoding="utf-8"))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
