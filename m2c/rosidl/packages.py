"""Interface packages as people have them, and what colcon needs of them that they may lack.

A folder with definitions in ``msg``, ``srv`` or ``action`` is enough: ``package.xml``, ``CMakeLists.txt`` and
the build type are made where they are missing, in a copy. What cannot be built is known before colcon
runs, with its reason.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, Position, Severity
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.paths import meant
from m2c.model.xml import Element, read_xml
from m2c.model.xml_writing import below, element, serialised
from m2c.printable import near

KINDS = ("msg", "srv", "action")
DEPTH = 3
"""How far below a given folder packages are looked for."""
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
"""https://design.ros2.org/articles/legacy_interface_definition.html, "Conventions"."""
_USES = re.compile(r"\s*([A-Za-z]\w*)/")
"""The package of a field's type, at the start of a line."""


class Package(msgspec.Struct, frozen=True, kw_only=True):
    """A package that was found.

    Attributes:
        name: by which ROS 2 knows it: what ``package.xml`` says, else its folder's.
        folder: where it is.
        types: its definitions, such as ``srv/Tick``; none for a package of programs.
        complete: colcon can build it as it is.
        fault: why it cannot be built; "" if nothing is known against it.
    """

    name: str
    folder: Path
    types: tuple[str, ...] = ()
    complete: bool = True
    fault: str = ""

    def needs(self) -> set[str]:
        """The packages whose types its definitions use."""
        found = {"action_msgs"} if any(name.startswith("action/") for name in self.types) else set()
        for name in self.types:
            for line in self.file(name).read_text(errors="replace").splitlines():
                used = _USES.match(line)
                if used is not None:
                    found.add(used[1])
        return found - {self.name}

    def file(self, name: str) -> Path:
        """The definition of the type ``name`` of ``types``."""
        return self.folder / f"{name}.{name.partition('/')[0]}"


def find_packages(directories: Sequence[Path]) -> tuple[Package, ...]:
    """The packages in or below ``directories``, sorted by name; two of one name have a fault.

    Raises:
        NoPackageError: a directory does not exist or holds no package.
    """
    found: dict[Path, Package] = {}
    for directory in directories:
        if not os.path.isdir(directory):
            if os.path.exists(directory):
                raise NoPackageError(f"{directory}: is not a folder")
            hint = meant(directory)
            raise NoPackageError(f"{directory}: no such folder" + (f"; {hint}" if hint else ""))
        before = len(found)
        found.update((folder, _read(folder)) for folder in _below(directory, DEPTH))
        if len(found) == before and directory not in found:
            raise NoPackageError(
                f"{directory}: no ROS interface package here; expected definitions in "
                "<package>/msg, srv or action"
            )
    packages = sorted(found.values(), key=lambda package: (package.name, package.folder))
    firsts: dict[str, Path] = {}
    for index, package in enumerate(packages):
        first = firsts.setdefault(package.name, package.folder)
        if first != package.folder:
            fault = f"a second package is called so; the first is {near(first)}"
            packages[index] = msgspec.structs.replace(package, fault=fault)
    return tuple(packages)


class NoPackageError(Exception):
    """A folder holds no package; the text says what was expected."""


def _below(folder: Path, depth: int) -> Iterator[Path]:
    if (folder / "COLCON_IGNORE").exists():
        return
    if (folder / "package.xml").is_file() or _has_definitions(folder):
        yield folder
        return
    for inner in sorted(folder.iterdir()) if depth else ():
        if inner.is_dir() and not inner.is_symlink() and not inner.name.startswith("."):
            yield from _below(inner, depth - 1)


def _has_definitions(folder: Path) -> bool:
    """Whether a folder without ``package.xml`` is meant as a package: it may lack definitions yet."""
    for kind in KINDS:
        inner = folder / kind
        if inner.is_dir():
            entries = list(inner.iterdir())
            if not entries or any(entry.suffix == f".{kind}" for entry in entries):
                return True
    return False


def _read(folder: Path) -> Package:
    types = tuple(
        f"{kind}/{path.stem}"
        for kind in KINDS
        for path in sorted((folder / kind).glob(f"*.{kind}"))
    )
    manifest = folder / "package.xml"
    name, complete, fault = folder.name, False, ""
    builds = ""
    if manifest.is_file():
        log = DiagnosticLog()
        root = read_xml(manifest, log)
        if root is None:
            fault = str(next(f for f in log.diagnostics if f.severity is Severity.ERROR))
        else:
            name = _text(root.first("name")) or folder.name
            export = root.first("export")
            builds = _text(export.first("build_type")) if export is not None else ""
            complete = bool(builds and _text(root.first("name")))
    makes_types = bool(types) or builds in ("", "ament_cmake")
    if builds not in ("", "ament_python"):
        complete = complete and (folder / "CMakeLists.txt").is_file()
    if not fault and makes_types and not types and not complete:
        fault = "it has no .msg, .srv or .action file"
    if not fault and types and _NAME.fullmatch(name) is None:
        fault = (
            f"ROS 2 allows no package called `{name}`; lower-case letters, digits and single "
            "underscores, beginning with a letter"
        )
    return Package(name=name, folder=folder, types=types, complete=complete, fault=fault)


def _text(found: Element | None) -> str:
    return "" if found is None else found.text.strip()


def checked(packages: Sequence[Package], installed: Sequence[Path]) -> tuple[Package, ...]:
    """``packages``, with a fault for those whose definitions are wrong or use what is not there.

    Args:
        packages: all that are to be built.
        installed: prefixes where other packages are installed (``share/<package>/package.xml``).
    """
    faults = {package.folder: package.fault or _wrong(package, packages) for package in packages}
    names = {package.name for package in packages if package.types}
    sound = {package.name for package in packages if not faults[package.folder]}
    changed = True
    while changed:
        changed = False
        for package in packages:
            if faults[package.folder]:
                continue
            for name in sorted(package.needs() - sound):
                if any((prefix / "share" / name / "package.xml").is_file() for prefix in installed):
                    continue
                given = name in names
                why = "which is not built" if given else "which is neither given here nor installed"
                faults[package.folder] = f"it uses types of `{name}`, {why}"
                sound.discard(package.name)
                changed = True
                break
    return tuple(
        msgspec.structs.replace(package, fault=faults[package.folder]) for package in packages
    )


def _wrong(package: Package, packages: Sequence[Package]) -> str:
    """The first fault of the definitions of ``package``; what others' types are, is theirs."""
    log = DiagnosticLog()
    library = InterfaceLibrary.load([other.folder for other in packages if other.types], log)
    read = {"msg": library.message, "srv": library.service, "action": library.action}
    for name in package.types:
        kind, _, last = name.partition("/")
        try:
            read[kind](f"{package.folder.name}/{kind}/{last}")
        except KeyError:
            continue  # a fault of the file, which the log has
    own = {other.folder.name for other in packages}
    for found in log.diagnostics:
        if found.severity is not Severity.ERROR or "allows no package" in found.message:
            continue
        unknown = re.match(r"unknown type (\w+)/", found.message)
        if unknown is not None and unknown[1] not in own:
            continue  # of a package that may be installed
        if Path(found.position.file).is_relative_to(package.folder):
            return _told(found.position, found.message, found.hint)
    return ""


def _told(position: Position, message: str, hint: str) -> str:
    return f"{near(str(position))}: {message}" + (f"; {hint}" if hint else "")


def completed(package: Package, folder: Path) -> Path:
    """A copy of ``package`` below ``folder`` that has all that colcon needs; the original stays as it is.

    Returns:
        The copy.
    """
    made = folder / package.name
    shutil.copytree(package.folder, made, symlinks=True)
    for file, text in files_around(package.name, package.types, package.needs()).items():
        if file == "package.xml" or not (made / file).is_file():
            (made / file).write_text(text)
    return made


def files_around(name: str, types: Sequence[str], needs: Iterable[str]) -> dict[str, str]:
    """What colcon needs of an interface package besides its definitions: each file's name and text.

    Args:
        name: of the package.
        types: its definitions, such as ``srv/Tick``.
        needs: the packages whose types they use.
    """
    needed = sorted(needs)
    return {
        "package.xml": _package_xml(name, needed),
        "CMakeLists.txt": _cmake(name, types, needed),
    }


def _package_xml(name: str, needs: Sequence[str]) -> str:
    root = element("package", {"format": "3"})
    for tag, text in (
        ("name", name),
        ("version", "0.0.0"),
        ("description", f"Interfaces: {name}"),
    ):
        below(root, tag, {}, text)
    below(root, "maintainer", {"email": "nobody@example.org"}, "nobody")
    for tag, text in (
        ("license", "unknown"),
        ("buildtool_depend", "ament_cmake"),
        ("build_depend", "rosidl_default_generators"),
        *(("depend", needed) for needed in needs),
        ("exec_depend", "rosidl_default_runtime"),
        ("member_of_group", "rosidl_interface_packages"),
    ):
        below(root, tag, {}, text)
    below(below(root, "export", {}), "build_type", {}, "ament_cmake")
    return serialised(root)


def _cmake(name: str, types: Sequence[str], needs: Sequence[str]) -> str:
    listed = [f'  "{kind}.{kind.partition("/")[0]}"' for kind in types]
    return "\n".join(
        [
            "cmake_minimum_required(VERSION 3.8)",
            f"project({name})",
            "find_package(ament_cmake REQUIRED)",
            "find_package(rosidl_default_generators REQUIRED)",
            *(f"find_package({needed} REQUIRED)" for needed in needs),
            "rosidl_generate_interfaces(${PROJECT_NAME}",
            *listed,
            *([f"  DEPENDENCIES {' '.join(needs)}"] if needs else []),
            ")",
            "ament_package()",
            "",
        ]
    )


def prefixes() -> tuple[Path, ...]:
    """Where packages are installed: this environment, and those that were sourced."""
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return (Path(sys.prefix), *(Path(prefix) for prefix in sourced if prefix))
