"""Build ROS interface packages (``.msg/.srv/.action``) with colcon, inside a virtual environment.

``bt_interfaces`` is built with them, unless they have one or one is installed. What is said to be built
was imported by a process that knows no more than the setup script.

The pip wheels of ROS 2 Jazzy carry CMake files with two absolute paths of the machine that made
them (the interpreter's and numpy's include folders); they are pointed at this interpreter before
the build. The result is cached by the content of the packages.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from m2c.model import builtin
from m2c.rosidl.colcon import SHOWN_LINES, Tell, followed
from m2c.rosidl.packages import (
    NoPackageError,
    Package,
    checked,
    completed,
    find_packages,
    prefixes,
)

BUILD_TIMEOUT_S = 600
"""A lab-tour-sized set of packages takes about 20 s on two cores; an hour-long build is a hang."""

IMPORT_TIMEOUT_S = 60
"""An import takes half a second."""
_NOT_INSTALLED = "colcon could not build it"
_WHEEL_PYTHON_INCLUDE = re.compile(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+")
_WHEEL_NUMPY_INCLUDE = re.compile(r"/opt/python/[^;\" ]*/numpy/_?core/include")
OUTPUT = Path("build/interfaces")
"""Where what is built goes, unless another folder is named; ``m2c interfaces build`` says the same."""
SETUP_SCRIPT = "setup.sh"
"""What colcon's own would be, which needs more of ROS 2 than the wheels have."""
CMAKE_ARGUMENTS = (
    f"-DPython3_EXECUTABLE={sys.executable}",
    f"-DCMAKE_PROJECT_INCLUDE_BEFORE={Path(__file__).with_name('python_first.cmake')}",
)
"""This interpreter, which is asked once what it is."""
_STAMP = "content.sha256"
_BEGUN_AGAIN = "M2C_INTERFACES_BUILT"
"""Set where ``begin_again_with`` has begun a process again: once is enough."""


class InterfaceBuildError(Exception):
    """The packages cannot be built here; the text says what is missing and how to get it.

    Attributes:
        lines: that, and below it the last lines of what the tool wrote.
    """

    def __init__(self, message: str, written: Sequence[str] = ()) -> None:
        self.lines = (message, *written)
        super().__init__("\n".join(self.lines))


class Unbuilt(msgspec.Struct, frozen=True):
    """A package that was not built: why, and the last lines of what the tools wrote on it."""

    name: str
    reason: str
    written: tuple[str, ...] = ()


class InterfaceInstall(msgspec.Struct, frozen=True):
    """A finished build: ``prefix`` has one folder per package of ``packages``.

    Attributes:
        prefix: where they are installed.
        packages: the names of those that are built, sorted.
        cached: nothing had changed since the last build.
        types: what each of them defines, such as ``srv/Tick``.
        unbuilt: those that are not built.
    """

    prefix: Path
    packages: tuple[str, ...]
    cached: bool
    types: tuple[tuple[str, ...], ...] = ()
    unbuilt: tuple[Unbuilt, ...] = ()

    def environment(self, base: Mapping[str, str] | None = None) -> dict[str, str]:
        """Environment variables with which a process finds the packages (there is no setup.bash).

        Args:
            base: what to extend; this process's environment by default.
        """
        environment = dict(os.environ if base is None else base)
        site = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"
        roots = [self.prefix / package for package in self.packages]
        for variable, parts in (
            ("PYTHONPATH", [root / site for root in roots]),
            ("LD_LIBRARY_PATH", [root / "lib" for root in roots]),
            ("AMENT_PREFIX_PATH", [*roots, Path(sys.prefix)]),
        ):
            known = environment.get(variable, "")
            environment[variable] = os.pathsep.join([*map(str, parts), *([known] if known else [])])
        return environment

    def setup_script(self) -> str:
        """A shell script that does to a shell what ``environment`` does."""
        lines = [
            f"export {variable}={shlex.quote(value)}${{{variable}:+:${variable}}}"
            for variable, value in self.environment({}).items()
        ]
        return "\n".join(["# Source it: processes started here find the packages.", *lines, ""])


def begin_again_with(directories: Sequence[Path], output: Path) -> None:
    """Make interface packages importable in this process: build them, and start it anew with them.

    The folders that libraries are loaded from are read when a process begins; so this one begins again,
    with its arguments. Nothing is done where the packages are importable (a sourced workspace). For
    programs; a library has no business to restart its process.

    Args:
        directories: as for ``build_interfaces``.
        output: as for ``build_interfaces``.

    Raises:
        InterfaceBuildError: they cannot be built, or are not importable when they are.
    """
    names = [package.name for package in _packages(directories, output)]
    missing = [name for name in names if not is_importable(name)]
    if not missing:
        return
    if os.environ.get(_BEGUN_AGAIN):
        raise InterfaceBuildError(f"{output}: built, and not importable: {', '.join(missing)}")
    environment = build_interfaces(directories, output).environment()
    sys.stdout.flush()
    sys.stderr.flush()
    again = [sys.executable, *sys.orig_argv[1:]]
    os.execve(sys.executable, again, {**environment, _BEGUN_AGAIN: "yes"})


def is_importable(name: str) -> bool:
    """Whether this process finds the package ``name``: a folder of definitions called so is none."""
    spec = importlib.util.find_spec(name)
    return spec is not None and spec.origin is not None


def build_once(package: Path) -> InterfaceInstall:
    """``package`` for this interpreter, built once for all in the user's cache folder.

    Args:
        package: the folder of an interface package; ``builtin.FOLDER`` is that of ``bt_interfaces``.

    Raises:
        InterfaceBuildError: it cannot be built.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "m2c" / f"interfaces-{_content_hash([package])[:16]}"
    return build_interfaces([package], folder)


def _packages(directories: Sequence[Path], output: Path) -> tuple[Package, ...]:
    """Those in ``directories``, and the built-in one, unless it is there or installed elsewhere.

    What was built into ``output`` with it stays so: it is then not built anew in a shell that has another.
    """
    try:
        packages = find_packages(directories)
        if not any(package.name == builtin.PACKAGE for package in packages):
            elsewhere = [path for path in prefixes() if not path.is_relative_to(output)]
            share = Path("share") / builtin.PACKAGE / "package.xml"
            is_here = (output / "install" / builtin.PACKAGE / share).is_file()
            if is_here or not any((path / share).is_file() for path in elsewhere):
                packages = find_packages([*directories, builtin.FOLDER])
    except NoPackageError as error:
        raise InterfaceBuildError(str(error)) from error
    return packages


def build_interfaces(directories: Sequence[Path], output: Path) -> InterfaceInstall:
    """Build every package as :func:`build_packages` does, or fail.

    Raises:
        InterfaceBuildError: besides, a package is not built.
    """
    built = build_packages(directories, output)
    if built.unbuilt:
        lines = [f"{item.name} is not built: {item.reason}" for item in built.unbuilt]
        raise InterfaceBuildError(lines[0], (*built.unbuilt[0].written, *lines[1:]))
    return built


def _say_nothing(_: str) -> None:
    pass


def build_packages(
    directories: Sequence[Path], output: Path, tell: Tell = _say_nothing
) -> InterfaceInstall:
    """Build every package in or below ``directories``, and ``bt_interfaces``, into ``output/install``.

    Args:
        directories: ROS interface packages, or folders of them; what they lack for colcon is made in
            ``output``. Packages of programs (``ament_python``) are built, too.
        output: where colcon's build, install and log folders go.
        tell: gets a line when colcon begins, and for each package that it begins or finishes.

    Returns:
        The install, with those that cannot be built; ``cached`` says that nothing had changed since
        the last build, which had built all.

    Raises:
        InterfaceBuildError: there is no package, a tool or wheel is missing, or ``output`` has other
            content.
    """
    found = _packages(directories, output)
    digest = _content_hash([package.folder for package in found])
    stamp = output / _STAMP
    prefix = output / "install"
    whole = InterfaceInstall(
        prefix,
        tuple(package.name for package in found),
        cached=True,
        types=tuple(package.types for package in found),
    )
    if (
        stamp.is_file()
        and stamp.read_text() == digest
        and all((prefix / name).is_dir() for name in whole.packages)
    ):
        return _with_setup(whole, output)
    _require_tools()
    _repair_wheel_paths(Path(sys.prefix))
    _empty(output, stamp)
    elsewhere = [path for path in prefixes() if not path.is_relative_to(output)]
    found = checked(found, elsewhere)
    sound = [package for package in found if not package.fault]
    unbuilt = [Unbuilt(package.name, package.fault) for package in found if package.fault]
    written: tuple[str, ...] = ()
    if sound:
        folders = [
            package.folder if package.complete else completed(package, output / "src")
            for package in sound
        ]
        names = ", ".join(package.name for package in sound)
        tell(f"building with colcon, which takes some ten seconds for each package: {names}")
        written = _run_colcon(folders, output, tell)
    built = msgspec.structs.replace(whole, cached=False, packages=tuple(p.name for p in sound))
    _with_setup(built, output)  # for the processes that import them
    for package in sound:
        reason = why_not_importable(package, output)
        if reason:
            said = (_said_of(package.name, output) or written) if reason == _NOT_INSTALLED else ()
            unbuilt.append(Unbuilt(package.name, reason, said))
    lost = {item.name for item in unbuilt}
    sound = [package for package in sound if package.name not in lost]
    if not unbuilt:
        stamp.write_text(digest)
    return _with_setup(
        InterfaceInstall(
            prefix,
            tuple(package.name for package in sound),
            cached=False,
            types=tuple(package.types for package in sound),
            unbuilt=tuple(sorted(unbuilt, key=lambda item: item.name)),
        ),
        output,
    )


_IMPORT = """
import importlib, sys
package, *types = sys.argv[1:]
importlib.import_module(package)
if types:
    from rclpy.type_support import check_for_type_support
missing = []
for name in types:
    kind, _, last = name.partition("/")
    try:
        found = getattr(importlib.import_module(f"{package}.{kind}"), last)
    except (ModuleNotFoundError, AttributeError):
        missing.append(f"{name}.{kind}")
    else:
        check_for_type_support(found)
if missing:
    sys.exit("built without " + ", ".join(missing) + "; list it in CMakeLists.txt")
"""


def why_not_importable(package: Package, output: Path) -> str:
    """Why a process that has sourced the setup script cannot import the package with all its types.

    Returns:
        "" if it can.
    """
    root = output / "install" / package.name
    if not (root / "share" / package.name / "package.xml").is_file():
        return _NOT_INSTALLED
    if not package.types and not list(root.glob(f"lib/*/site-packages/{package.name}")):
        return ""  # launch files, say
    command = ["sh", "-c", '. "$0" && exec "$@"', str(output / SETUP_SCRIPT)]
    command += [sys.executable, "-P", "-c", _IMPORT, package.name, *package.types]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=IMPORT_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"it was not imported in {IMPORT_TIMEOUT_S} s"
    if done.returncode < 0:
        return f"to import it ended the process by signal {-done.returncode}"
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no reason is given"])[-1]
        return last if last.startswith("built without ") else f"it cannot be imported: {last}"
    return ""


def _said_of(name: str, output: Path) -> tuple[str, ...]:
    """The last lines of what colcon's tools wrote on a package that they failed at."""
    for file in ("stderr.log", "stdout_stderr.log"):
        try:
            lines = (output / "log" / "latest_build" / name / file).read_text(errors="replace")
        except OSError:
            continue
        if lines.strip():
            return tuple(lines.splitlines()[-SHOWN_LINES:])
    return ()


def _with_setup(install: InterfaceInstall, output: Path) -> InterfaceInstall:
    file, script = output / SETUP_SCRIPT, install.setup_script()
    if not file.is_file() or file.read_text() != script:  # a shell may be reading it
        file.write_text(script)
    return install


def _empty(output: Path, stamp: Path) -> None:
    """Empty the folder, if an earlier build made it; an unfinished one leaves an empty stamp."""
    if output.exists() and any(output.iterdir()):
        if not stamp.is_file():
            raise InterfaceBuildError(
                f"{output} is not empty and no build of interfaces made it; "
                "its content would be replaced: give a folder of its own"
            )
        for (
            path
        ) in output.iterdir():  # the folder itself may be a link, or where something is mounted
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    output.mkdir(parents=True, exist_ok=True)
    stamp.write_text("")
    (output / "COLCON_IGNORE").touch()  # a build in the folder above finds no packages in here


def _content_hash(packages: Sequence[Path]) -> str:
    digest = hashlib.sha256(f"{sys.prefix} {sys.version}".encode())
    for package in packages:
        for path in sorted(package.rglob("*")):
            if path.is_file():
                digest.update(f"\0{package.name}/{path.relative_to(package)}\0".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def missing_tools() -> list[str]:
    """What lacks here to build interface packages, each with what brings it; empty if nothing does."""
    missing = []
    for command, remedy in (
        ("cmake", "pip install cmake"),
        ("make", "apt install make"),
        ("c++", "apt install g++"),
    ):
        if shutil.which(command, path=search_path()) is None:
            missing.append(f"{command} ({remedy})")
    if not (Path(sysconfig.get_path("include")) / "Python.h").is_file():
        missing.append("Python.h (apt install python3-dev)")
    for module, remedy in (
        ("colcon_core", "colcon-common-extensions"),
        ("rclpy", "ros-jazzy-rclpy"),
    ):
        if importlib.util.find_spec(module) is None:
            missing.append(f"{remedy} (pip install 'm2c-moon[ros2]')")
    return missing


def _require_tools() -> None:
    if missing := missing_tools():
        raise InterfaceBuildError(f"cannot build interface packages; missing: {', '.join(missing)}")


def search_path() -> str:
    """Where commands are looked for: what pip brought first, also where its folder is not in PATH."""
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])


def _repair_wheel_paths(root: Path) -> None:
    import numpy  # comes with the ROS 2 wheels, not with us

    for path in (root / "share").rglob("*.cmake"):
        text = path.read_text(errors="surrogateescape")
        if "/opt/python/" not in text:
            continue
        repaired = _WHEEL_NUMPY_INCLUDE.sub(numpy.get_include(), text)
        repaired = _WHEEL_PYTHON_INCLUDE.sub(sysconfig.get_paths()["include"], repaired)
        if repaired != text:
            path.write_text(repaired, errors="surrogateescape")


def _run_colcon(packages: Sequence[Path], output: Path, tell: Tell) -> tuple[str, ...]:
    """Build; the last lines that colcon wrote if not all was well. ``tell`` gets its progress."""
    environment = {
        **os.environ,
        "VIRTUAL_ENV": sys.prefix,
        "CMAKE_PREFIX_PATH": sys.prefix,
        "AMENT_PREFIX_PATH": sys.prefix,
        "PATH": search_path(),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONUNBUFFERED": "1",
    }
    command = [
        *(sys.executable, "-m", "colcon", "--log-base", str(output / "log")),
        *("build", "--continue-on-error", "--base-paths", *map(str, packages)),
        *("--build-base", str(output / "build"), "--install-base", str(output / "install")),
        *("--cmake-args", *CMAKE_ARGUMENTS, "-DBUILD_TESTING=OFF"),
    ]
    code, written = followed(command, environment, output, tell, BUILD_TIMEOUT_S)
    if code is None:
        raise InterfaceBuildError(f"colcon did not finish in {BUILD_TIMEOUT_S} s")
    return () if code == 0 else written or ("colcon failed",)
