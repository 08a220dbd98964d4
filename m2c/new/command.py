"""``m2c new``."""

from __future__ import annotations

from pathlib import Path

import click

from m2c.inputs import ExistingPath
from m2c.terminal import fail, show

_SYSTEM = "system"
_WHAT = ("skill", "component", "plugin")


@click.command()
@click.argument("words", nargs=-1, required=True, metavar="[system|skill|component|plugin] NAME")
@click.option(
    "--templates",
    type=ExistingPath(path_type=Path, exists=True, file_okay=False),
    help="Folder of your own Jinja2 templates: they override ours of the same name.",
)
def new(words: tuple[str, ...], templates: Path | None) -> None:
    """Begin a system, or add a model to the one in this folder.

    With NAME alone, or `system` before it, a folder of that name gets a system that runs at once: a
    skill, a component, a tree, an interface, properties and a test. In such a folder `skill`,
    `component` and `plugin` write a model and name it in system.xml.

    Exit code 0, or 2 if a name is not allowed or taken, or the folder is not empty.

    \b
    Example:
      m2c new demo && cd demo && m2c run --transport simulated --ticks 20
      m2c new skill Dock
    """
    from m2c.codegen.rendering import TemplateFault, Templates
    from m2c.new.project import NewError, new_model, new_system

    kind, name = ("", words[0]) if len(words) == 1 else (words[0], words[1])
    known = (_SYSTEM, *_WHAT)
    if len(words) > 2 or (kind and kind not in known):
        raise click.UsageError(f"expected NAME, or one of {', '.join(known)} and a NAME")
    if name in known and not kind:
        raise click.UsageError(f"`{name}` needs a name: m2c new {name} NAME")
    try:
        found = Templates(templates, "m2c.new")
        if kind in _WHAT:
            path, leaf = new_model(kind, name, Path(), found)
            show(f"{path} is written, and named in system.xml")
            show(*([f"its leaf in a policy: {leaf}"] if leaf else []))
        else:
            made = new_system(name, Path(name), found)
            show(f"{name}: {len(made)} files; go on with")
            show(f"  cd {name} && m2c run --transport simulated --ticks 20")
    except (NewError, TemplateFault) as error:
        fail(str(error))
    except OSError as error:
        fail(f"{error.filename}: {error.strerror}")
