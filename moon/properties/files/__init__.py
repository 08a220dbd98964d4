"""Property files of either kind."""

from __future__ import annotations

from pathlib import Path

from m2c.diagnostics import DiagnosticLog, Position
from moon.properties.files.interfaces import Interfaces
from moon.properties.property import Property


def read_properties(
    path: Path, log: DiagnosticLog, interfaces: Interfaces | None = None
) -> list[Property]:
    """The properties of the file at ``path`` (``.xml``, ``.yaml`` or ``.yml``).

    Whatever is wrong goes to ``log``; a property with an error is left out. With ``interfaces``,
    channels, fields and types that do not fit them are wrong, too.
    """
    match path.suffix.lower():
        case ".xml":
            from moon.properties.files.xml import read_property_xml

            return read_property_xml(path, log, interfaces)
        case ".yaml" | ".yml":
            from moon.properties.files.yaml import read_property_yaml

            return read_property_yaml(path, log, interfaces)
        case suffix:
            what = f"`{suffix}` is no kind of property file" if suffix else "the file has no suffix"
            log.error("unreadable-file", Position(str(path)), "", what, ".xml, .yaml or .yml")
            return []


def load_properties(
    *paths: Path, interfaces: Interfaces | None = None, log: DiagnosticLog | None = None
) -> list[Property]:
    """The properties of all files at ``paths``.

    Args:
        paths: property files.
        interfaces: what they are held against, if anything.
        log: where findings go.

    Raises:
        ModelError: with everything that is wrong in them.
    """
    log = log or DiagnosticLog()
    found: dict[str, Property] = {}
    for path in paths:
        for item in read_properties(path, log, interfaces):
            if item.name in found:
                first = found[item.name].position
                what = f"`{item.name}` is declared twice"
                log.error("bad-property-file", item.position, "", what, f"first at {first}")
            found[item.name] = item
    log.raise_if_errors()
    return list(found.values())


def parse_properties(text: str, name: str, interfaces: Interfaces | None = None) -> list[Property]:
    """The properties of ``text``: XML if it begins with ``<``, else YAML.

    Args:
        text: the contents of a property file.
        name: what findings call it.
        interfaces: what they are held against, if anything.

    Raises:
        ModelError: with everything that is wrong in it.
    """
    log = DiagnosticLog()
    content = text.encode("utf-8", "surrogatepass")
    if text.lstrip().startswith("<"):
        from moon.properties.files.xml import parse_property_xml

        found = parse_property_xml(content, name, log, interfaces)
    else:
        from moon.properties.files.yaml import parse_property_yaml

        found = parse_property_yaml(content, name, log, interfaces)
    log.raise_if_errors()
    return found
