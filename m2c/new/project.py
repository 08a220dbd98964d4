"""What ``m2c new`` writes: a system's files, or a model and the line of the system file that names it."""

from __future__ import annotations

import re
from pathlib import Path

from m2c.codegen.names import package_name
from m2c.codegen.rendering import Templates
from m2c.codegen.source import Source
from m2c.diagnostics import DiagnosticLog
from m2c.model.loading import load
from m2c.output_file import write_whole

KINDS = {
    "skill": ("skills", "node_models", "node-ascxml"),
    "component": ("components", "node_models", "node-ascxml"),
    "plugin": ("plugins", "behavior_tree", "bt-plugin-ascxml"),
}
"""Of each kind of model its folder, and the element and type by which a system file names it."""
SYSTEM = "system.xml"
_SYSTEM_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_MODEL_NAME = re.compile(r"[A-Z][A-Za-z0-9]*")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_MOST = 60
"""Characters of a name: channels and packages are made of it."""
_FILES = {
    SYSTEM: "system.xml.j2",
    "policy.xml": "policy.xml.j2",
    "properties.yaml": "properties.yaml.j2",
    "README.md": "README.md.j2",
    "test_system.py": "test_system.py.j2",
    "components/Worker.ascxml": "worker.ascxml.j2",
    "skills/WorkSkill.ascxml": "work_skill.ascxml.j2",
    "interfaces/{name}_interfaces/srv/Start.srv": "Start.srv.j2",
}


class NewError(Exception):
    """It cannot be begun so; the text says why, and what would be right."""


def new_system(name: str, folder: Path, templates: Templates) -> list[Path]:
    """Write a system called ``name`` into ``folder``, which is made.

    Returns:
        The files.

    Raises:
        NewError: the name is not allowed, or the folder is not empty.
        TemplateFault: a template cannot be used.
        OSError: a file cannot be written.
    """
    if not _SYSTEM_NAME.fullmatch(name) or len(name) > _MOST or package_name(name) != name:
        raise NewError(
            f"`{name[:_MOST]}` cannot be a system's name: packages of Python and ROS 2 are called so; "
            "use lower-case letters, digits and single underscores, as in my_robot, and no name that "
            "Python, ROS 2 or m2c has already"
        )
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise NewError(
            f"{folder} is there already, and is not an empty folder; choose another name"
        )
    made = {
        folder / path.format(name=name): templates.render(template, name, name=Source(name))
        for path, template in _FILES.items()
    }
    _write(made)
    return list(made)


def new_model(kind: str, name: str, folder: Path, templates: Templates) -> tuple[Path, str]:
    """Write a model into the system in ``folder``, and name it in its system file.

    Args:
        kind: one of :data:`KINDS`.
        name: of the model; that of a skill gets ``Skill`` at its end.
        folder: has a ``system.xml``.
        templates: by which it is written.

    Returns:
        The model's file, and the element that is its leaf in a policy; "" for a component.

    Raises:
        NewError: the name is not allowed or taken, or there is no system file that can be added to.
        TemplateFault: a template cannot be used.
        OSError: a file cannot be read or written.
    """
    if not _MODEL_NAME.fullmatch(name) or len(name) > _MOST:
        raise NewError(f"`{name[:_MOST]}` cannot be a {kind}'s name; write it like GoToDock")
    leaf = name.removesuffix("Skill") if kind == "skill" else name
    if not leaf:
        raise NewError("`Skill` says nothing of what the skill does; write it like GoToDock")
    called = f"{leaf}Skill" if kind == "skill" else name
    below, element, type_name = KINDS[kind]
    system, path = folder / SYSTEM, folder / below / f"{called}.ascxml"
    if not system.is_file():
        raise NewError(f"no {SYSTEM} in this folder; `m2c new NAME` makes a system")
    if path.exists():
        raise NewError(f"{path} is there already; choose another name")
    taken = _called_alike(called, system)
    if taken is not None:
        raise NewError(f"{SYSTEM} has a model called `{taken}` already; choose another name")
    try:
        text = system.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise NewError(f"{SYSTEM} is not in UTF-8; name the model there by hand") from None
    added = _with_input(
        text, element, f'<input type="{type_name}" src="./{below}/{called}.ascxml"/>'
    )
    model = templates.render(f"{kind}.ascxml.j2", called, name=Source(called), leaf=Source(leaf))
    _write({path: model, system: added})
    match kind:
        case "skill":
            return path, f'<Action ID="ROS2Action" name="{leaf}" interface="ROS2SERVICE"/>'
        case "plugin":
            return path, f'<Action ID="{called}" name="{called}" value="1" least="1"/>'
    return path, ""


def _called_alike(name: str, system: Path) -> str | None:
    """The node or plugin of ``system`` whose package would be called as that of ``name``, if one is."""
    read = load([system], DiagnosticLog())
    machines = () if read is None else (*read.nodes, *read.plugins)
    alike = (one.name for one in machines if package_name(one.name) == package_name(name))
    return next(alike, None)


def _with_input(text: str, element: str, line: str) -> str:
    """A system file's ``text`` with ``line`` as the last of ``element``."""
    visible = _COMMENT.sub(lambda match: " " * len(match[0]), text)
    ends = [match.start() for match in re.finditer(rf"[ \t]*</{element}\s*>", visible)]
    if not ends:
        raise NewError(f"{SYSTEM} has no <{element}>…</{element}>; write one, and try again")
    indent = re.match(r"[ \t]*", text[ends[-1] :])
    space = indent[0] if indent is not None else ""
    return f"{text[: ends[-1]]}{space}  {line}\n{text[ends[-1] :]}"


def _write(files: dict[Path, str]) -> None:
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
