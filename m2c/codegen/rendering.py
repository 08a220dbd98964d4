"""Generated files from Jinja2 templates: ours, or a user's own that override or extend them by name.

What a template prints was made for a file of its kind, or is refused: text of a model is plain ``str``,
which no template prints without one of the filters of ``m2c.codegen.source``. Templates are sandboxed: one
that was written by a stranger can write what it likes, but runs nothing while files are generated.
"""

from __future__ import annotations

import functools
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import jinja2
from jinja2.sandbox import ImmutableSandboxedEnvironment
from markupsafe import Markup

from m2c.codegen.program import CONTEXT_VERSION
from m2c.codegen.source import FILTERS, PlainTextError, Source
from m2c.model.file_size import size_of
from m2c.model.paths import entries_below

ENDING = ".j2"
OURS = "m2c/"
"""``{% extends "m2c/node.py.j2" %}``: our template, where a user's own has the same name."""

_MAX_BYTES = 1024 * 1024
"""Ours have at most 8 kB."""

_MARK_AS_PRINTABLE = ("e", "escape", "forceescape", "safe", "tojson", "urlize", "xmlattr")
"""Jinja's own filters whose results it prints as they are: right for HTML only, or for nothing."""

_FAULTS = (
    jinja2.TemplateError,
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)
"""What evaluating somebody's template may raise, besides being too deep."""


class TemplateFault(Exception):
    """A template cannot be used; its text names template, line, model and what is wrong."""


class Templates:
    """The templates that files are made from.

    Args:
        folder: a user's own, which come first; None for ours alone.
        package: whose folder ``templates`` has ours.
    """

    def __init__(self, folder: Path | None = None, package: str = "m2c.codegen") -> None:
        ours = jinja2.PackageLoader(package)
        self.names = tuple(sorted(ours.list_templates()))
        """Of our templates."""
        self._folder = folder
        self._own = _own_templates(folder) if folder is not None else frozenset()
        loaders: list[jinja2.BaseLoader] = [ours, jinja2.PrefixLoader({OURS.rstrip("/"): ours})]
        if folder is not None:
            loaders.insert(0, jinja2.FunctionLoader(self._text))
        self._environment = ImmutableSandboxedEnvironment(
            loader=jinja2.ChoiceLoader(loaders),
            undefined=jinja2.StrictUndefined,
            autoescape=True,
            finalize=_printed,
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
            auto_reload=False,
        )
        self._environment.filters |= {name: _of_something(made) for name, made in FILTERS.items()}
        self._environment.filters["join"] = _join
        for name in _MARK_AS_PRINTABLE:
            del self._environment.filters[name]
        self._environment.globals["context_version"] = CONTEXT_VERSION

    def _text(self, template: str) -> tuple[str, str, None] | None:
        """The text of a template of the user's, and its path (a function of Jinja's ``FunctionLoader``)."""
        if template not in self._own:
            return None
        assert self._folder is not None
        path = self._folder / template
        size = size_of(path)
        if size > _MAX_BYTES:
            raise ValueError(f"the template has {size} bytes; {_MAX_BYTES} are allowed")
        return path.read_text(encoding="utf-8"), str(path), None

    def render(self, template: str, model: str, **context: object) -> str:
        """The text that ``template`` makes.

        Args:
            template: its name, ``machine.py.j2``.
            model: what it is made for, as messages call it.
            context: see ``docs/templates.md``.

        Raises:
            TemplateFault: the template, or one that it uses, cannot be used.
        """
        try:
            return self._environment.get_template(template).render(**context)
        except jinja2.TemplateSyntaxError as error:
            name = error.name or template
            raise self._fault(name, error.lineno, model, error.message or "no template") from error
        except jinja2.TemplateNotFound as error:
            what = f"there is no template `{error.name}`; ours are: {', '.join(self.names)}"
            raise self._fault(template, _line(error)[1], model, what) from error
        except OSError as error:
            what = f"cannot be read: {error.strerror or error}"
            raise self._fault(str(error.filename or template), 0, model, what) from error
        except RecursionError as error:
            raise self._fault(
                template, 0, model, "is nested too deep, or includes itself"
            ) from error
        except _FAULTS as error:
            place, line = _line(error)
            raise self._fault(place or template, line, model, _reason(error)) from error

    def unused(self) -> list[Path]:
        """Files of the user's folder that make nothing: their names are none of ours, and no template
        that was used so far includes them.
        """
        loaded = {name for _, name in self._environment.cache or ()}
        unused = self._own.difference(self.names, loaded)
        return [self._folder / name for name in sorted(unused)] if self._folder is not None else []

    def fault(self, template: str, model: str, what: str) -> TemplateFault:
        """What is wrong with the text that ``template`` made."""
        return self._fault(template, 0, model, what)

    def _fault(self, template: str, line: int, model: str, what: str) -> TemplateFault:
        place = template
        if self._folder is not None and template in self._own:
            place = str(self._folder / template)
        at = f":{line}" if line else ""
        return TemplateFault(f"{place}{at}: for `{model}`: {what}")


@functools.cache
def our_templates() -> Templates:
    """The templates that come with m2c."""
    return Templates()


def _own_templates(folder: Path) -> frozenset[str]:
    try:
        found = entries_below(folder)
    except OSError as error:
        raise TemplateFault(
            f"{folder}: no folder of templates: {error.strerror or error}"
        ) from error
    return frozenset(
        path.relative_to(folder).as_posix() for path in found if path.name.endswith(ENDING)
    )


def _printed(value: Any) -> Any:
    """What ``{{ value }}`` prints; Jinja calls it for each."""
    if isinstance(value, jinja2.Undefined):
        return value  # printing it says what is missing
    if isinstance(value, Markup | int):
        return value
    raise PlainTextError(str(value))


def _of_something(function: Callable[..., Source]) -> Callable[..., Source]:
    """``function`` as a filter, which says what is missing where it is given what is not there."""

    def filtered(value: Any) -> Source:
        return function(str(value) if isinstance(value, jinja2.Undefined) else value)

    return filtered


def _join(values: Iterable[Any], separator: str = "") -> Source:
    """``values`` with ``separator`` in between. Jinja's own filter would print plain text among them."""
    return Source(separator).join(values)


def _line(error: BaseException) -> tuple[str, int]:
    """The innermost line of a template that ``error`` came through: its name and number."""
    found = ("", 0)
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename.endswith(ENDING):
            found = (frame.filename, frame.lineno or 0)
    return found


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
