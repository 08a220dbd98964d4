"""Makes what ``m2c run --replace NODE=PATH`` wants of a fault: a model, or a patched package.

``python examples/lab_tour/faults/inject.py T5 -o /tmp/faults`` prints ``BatteryLevelSkill=PATH``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec
from catalogue import FAULTS, HERE, Fault, Kind, fault

SYSTEM = HERE.parent / "system.xml"


class PatchError(Exception):
    """A patch does not fit the code that is generated today; the text says where and what to do."""


class Hunk(msgspec.Struct, frozen=True):
    """Lines that are replaced by others; ``line`` is where the patch's header says they begin."""

    file: str
    line: int
    old: tuple[str, ...]
    new: tuple[str, ...]


def replacement(chosen: Fault, folder: Path) -> Path:
    """What ``--replace`` runs in place of ``chosen.node``.

    Args:
        chosen: which fault.
        folder: where the package of a fault in the code is made; not used for models.

    Raises:
        PatchError: the patch does not fit the freshly generated code.
    """
    if chosen.kind is Kind.MODEL:
        return chosen.path
    package = folder / chosen.id
    files = generated(chosen.node)
    for path, text in patched(files, chosen.path).items():
        target = package / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)
    return package


def generated(node: str) -> dict[str, str]:
    """The files of ``node``'s package, as ``m2c generate`` writes them."""
    from m2c.codegen.package import system_files
    from m2c.model import DiagnosticLog, load

    log = DiagnosticLog()
    system = load([SYSTEM], log)
    if system is None or log.has_errors:
        raise PatchError("\n".join(str(found) for found in log.diagnostics))
    files = system_files(system)
    launch = msgspec.json.decode(files["launch.json"])
    prefix = next(item["path"] for item in launch["nodes"] if item["name"] == node) + "/"
    return {
        path.removeprefix(prefix): text for path, text in files.items() if path.startswith(prefix)
    }


def patched(files: dict[str, str], patch: Path) -> dict[str, str]:
    """``files`` with the unified diff in ``patch`` applied (``patch -p1`` would do the same).

    A hunk may have moved, but its old lines must be there, as they are and only once.

    Raises:
        PatchError: they are not.
    """
    changed = dict(files)
    for hunk in read_patch(patch):
        if hunk.file not in changed:
            raise PatchError(
                f"{patch.name}: it changes {hunk.file}, which is not generated; there are "
                f"{', '.join(sorted(changed))}"
            )
        lines = changed[hunk.file].splitlines()
        size = len(hunk.old)
        found = [
            index
            for index in range(len(lines) - size + 1)
            if tuple(lines[index : index + size]) == hunk.old
        ]
        if len(found) != 1:
            where = "is not there" if not found else f"is there {len(found)} times"
            raise PatchError(
                f"{patch.name}: does not fit the generated {hunk.file} any more: the text it "
                f"replaces (line {hunk.line}) {where}:\n  " + "\n  ".join(hunk.old) + "\n"
                "generate the node, make the change by hand and write the patch anew with diff -U0"
            )
        lines[found[0] : found[0] + size] = hunk.new
        changed[hunk.file] = "\n".join(lines) + "\n"
    return changed


def read_patch(patch: Path) -> list[Hunk]:
    """The hunks of a unified diff; what stands before the first ``---`` is a comment.

    Raises:
        PatchError: it is not a unified diff.
    """
    hunks: list[Hunk] = []
    file = ""
    for number, line in enumerate(patch.read_text().splitlines(), start=1):
        if line.startswith("--- ") or (not file and not line.startswith("+++ ")):
            continue
        if line.startswith("+++ "):
            file = line.removeprefix("+++ ").partition("/")[2]
        elif line.startswith("@@ "):
            start = line.split()[1].lstrip("-").partition(",")[0]
            hunks.append(Hunk(file, int(start), (), ()))
        elif hunks and line[:1] in ("-", "+", " "):
            last = hunks[-1]
            old = last.old if line[0] == "+" else (*last.old, line[1:])
            new = last.new if line[0] == "-" else (*last.new, line[1:])
            hunks[-1] = Hunk(last.file, last.line, old, new)
        else:
            raise PatchError(f"{patch.name}:{number}: not a line of a unified diff: {line}")
    if not hunks or any(not hunk.old for hunk in hunks):
        raise PatchError(f"{patch.name}: no hunk that replaces something")
    return hunks


def main() -> int:
    """The command line; prints the value for ``m2c run --replace``."""
    parser = argparse.ArgumentParser(description="Make a faulty node for `m2c run --replace`.")
    parser.add_argument("fault", choices=[item.id for item in FAULTS])
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("faults"), help="where a faulty package is made"
    )
    arguments = parser.parse_args()
    chosen = fault(arguments.fault)
    try:
        path = replacement(chosen, arguments.output)
    except PatchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{chosen.node}={path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
