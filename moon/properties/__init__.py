"""Past-time properties of what a tap receives: files, patterns, formulas, compiled monitors.

The names below are the interface; they are loaded when first used, so that the command line stays
quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from moon.properties.files import load_properties, read_properties
    from moon.properties.files.interfaces import Interfaces
    from moon.properties.formula import Formula
    from moon.properties.monitor import (
        PropertyMonitor,
        PropertySet,
        TimeOrderError,
    )
    from moon.properties.ordering import OrderedProperties
    from moon.properties.patterns import Pattern, PatternName, Scope, ScopeName, pattern_formula
    from moon.properties.property import (
        Fact,
        Port,
        Property,
        PropertySeverity,
        Status,
        Verdict,
        Witness,
    )
    from moon.properties.syntax import FormulaError, parse_formula

_HOMES = {
    "files": ("load_properties", "read_properties"),
    "formula": ("Formula",),
    "files.interfaces": ("Interfaces",),
    "monitor": ("PropertyMonitor", "PropertySet", "TimeOrderError"),
    "ordering": ("OrderedProperties",),
    "patterns": ("Pattern", "PatternName", "Scope", "ScopeName", "pattern_formula"),
    "property": ("Fact", "Port", "Property", "PropertySeverity", "Status", "Verdict", "Witness"),
    "syntax": ("FormulaError", "parse_formula"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Fact",
    "Formula",
    "FormulaError",
    "Interfaces",
    "OrderedProperties",
    "Pattern",
    "PatternName",
    "Port",
    "Property",
    "PropertyMonitor",
    "PropertySet",
    "PropertySeverity",
    "Scope",
    "ScopeName",
    "Status",
    "TimeOrderError",
    "Verdict",
    "Witness",
    "load_properties",
    "parse_formula",
    "pattern_formula",
    "read_properties",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME_OF[name]}"), name)
