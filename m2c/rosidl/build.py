"""Build ROS interface packages (``.msg/.srv/.action``) with colcon, inside a virtual environment.

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

from m2c.model.paths import meant

BUILD_TIMEOUT_S = 600
"""A lab-tour-sized set of packages takes about 20 s on two cores; an hour-long build is a hang."""

_WHEEL_PYTHON_INCLUDE = re.compile(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+")
_WHEEL_NUMPY_INCLUDE = re.compile(r"/opt/python/[^;\" ]*/numpy/_?core/include")
SETUP_SCRIPT = "setup.sh"
"""What colcon's own would be, which needs more of ROS 2 than the wheels have."""
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


class InterfaceInstall(msgspec.Struct, frozen=True):
    """A finished build: ``prefix`` has one folder per package of ``packages``."""

    prefix: Path
    packages: tuple[str, ...]
    cached: bool

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
    names = [path.name for path in find_packages(directories)]
    missing = [name for name in names if importlib.util.find_spec(name) is None]
    if not missing:
        return
    if os.environ.get(_BEGUN_AGAIN):
        raise InterfaceBuildError(f"{output}: built, and not importable: {', '.join(missing)}")
    environment = build_interfaces(directories, output).environment()
    sys.stdout.flush()
    sys.stderr.flush()
    again = [sys.executable, *sys.orig_argv[1:]]
    os.execve(sys.executable, again, {**environment, _BEGUN_AGAIN: "yes"})


def find_packages(directories: Sequence[Path]) -> tuple[Path, ...]:
    """The folders with a ``package.xml`` in or directly below ``directories``, sorted by name.

    Raises:
        InterfaceBuildError: a directory does not exist or holds no package.
    """
    found: list[Path] = []
    for directory in directories:
        candidates = [directory, *sorted(directory.iterdir())] if os.path.isdir(directory) else []
        packages = [path for path in candidates if (path / "package.xml").is_file()]
        if not packages and not os.path.lexists(directory):
            near = meant(directory)
            raise InterfaceBuildError(
                f"{directory}: no such folder" + (f"; {near}" if near else "")
            )
        if not packages:
            raise InterfaceBuildError(
                f"{directory}: no ROS interface package here; expected "
                "<package>/package.xml beside <package>/msg, srv or action"
            )
        found.extend(packages)
    return tuple(sorted(set(found), key=lambda path: path.name))


def build_interfaces(directories: Sequence[Path], output: Path) -> InterfaceInstall:
    """Build every interface package in or below ``directories`` into ``output/install``.

    Args:
        directories: ROS interface packages, or folders of them.
        output: where colcon's build, install and log folders go.

    Returns:
        The install; ``cached`` says that nothing had changed since the last build.

    Raises:
        InterfaceBuildError: a tool or wheel is missing, ``output`` has other content, or the build
            failed.
    """
    packages = find_packages(directories)
    names = tuple(path.name for path in packages)
    digest = _content_hash(packages)
    stamp = output / _STAMP
    prefix = output / "install"
    if (
        stamp.is_file()
        and stamp.read_text() == digest
        and all((prefix / n).is_dir() for n in names)
    ):
        return _with_setup(InterfaceInstall(prefix, names, cached=True), output)
    _require_tools()
    _repair_wheel_paths(Path(sys.prefix))
    _empty(output, stamp)
    _run_colcon(packages, output)
    stamp.write_text(digest)
    return _with_setup(InterfaceInstall(prefix, names, cached=False), output)


def _with_setup(install: InterfaceInstall, output: Path) -> InterfaceInstall:
    file, script = output / SETUP_SCRIPT, install.setup_script()
    if not file.is_file() or file.read_text() != script:  # a shell may be reading it
        file.write_text(script)
    return install


def _empty(output: Path, stamp: Path) -> None:
    """Make the folder anew, if an earlier build made it; an unfinished one leaves an empty stamp."""
    if output.exists() and any(output.iterdir()):
        if not stamp.is_file():
            raise InterfaceBuildError(
                f"{output} is not empty and no build of interfaces made it; "
                "its content would be replaced: give a folder of its own"
            )
        shutil.rmtree(output)
    output.mkdir(parents=True, exist_ok=True)
    stamp.write_text("")


def _content_hash(packages: Sequence[Path]) -> str:
    digest = hashlib.sha256(f"{sys.prefix} {sys.version}".encode())
    for package in packages:
        for path in sorted(package.rglob("*")):
            if path.is_file():
                digest.update(f"\0{package.name}/{path.relative_to(package)}\0".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _require_tools() -> None:
    missing = []
    for command, remedy in (
        ("cmake", "apt install cmake"),
        ("make", "apt install make"),
        ("c++", "apt install g++"),
    ):
        if shutil.which(command) is None:
            missing.append(f"{command} ({remedy})")
    for module, remedy in (
        ("colcon_core", "colcon-common-extensions"),
        ("rclpy", "ros-jazzy-rclpy"),
    ):
        if importlib.util.find_spec(module) is None:
            missing.append(f"{remedy} (pip install 'm2c-moon[ros2]')")
    if missing:
        raise InterfaceBuildError(f"cannot build interface packages; missing: {', '.join(missing)}")


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


def _run_colcon(packages: Sequence[Path], output: Path) -> None:
    scripts = Path(sys.executable).parent
    environment = {
        **os.environ,
        "VIRTUAL_ENV": sys.prefix,
        "CMAKE_PREFIX_PATH": sys.prefix,
        "AMENT_PREFIX_PATH": sys.prefix,
        "PATH": os.pathsep.join([str(scripts), os.environ.get("PATH", "")]),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [
        *(sys.executable, "-m", "colcon", "--log-base", str(output / "log")),
        *("build", "--base-paths", *map(str, packages)),
        *("--build-base", str(output / "build"), "--install-base", str(output / "install")),
        *("--cmake-args", f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF"),
    ]
    try:
        done = subprocess.run(
            command,
            env=environment,
            cwd=output,
            capture_output=True,
            text=True,
            timeout=BUILD_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as expired:
        raise InterfaceBuildError(f"colcon did not finish in {BUILD_TIMEOUT_S} s") from expired
    if done.returncode:
        raise InterfaceBuildError(
            f"colcon build failed with exit code {done.returncode}:",
            (done.stdout + done.stderr).splitlines()[-25:],
        )
