"""``bt_interfaces``, the types of a behaviour tree's ticks and halts, which comes with this package.

It is a ROS interface package in ROS layout, so that colcon builds it as any other.
"""

from __future__ import annotations

from pathlib import Path

PACKAGE = "bt_interfaces"
PUBLISHED = "bt_interfaces_dummy"
"""How the published models call the same package."""

FOLDER = Path(__file__).parents[1] / "interfaces" / PACKAGE

BUILTIN: dict[str, Path] = {
    f"{package}/{path.parent.name}/{path.stem}": path
    for path in sorted(FOLDER.glob("*/*.*"))
    for package in (PACKAGE, PUBLISHED)
    if path.suffix[1:] == path.parent.name
}
"""The file of each type, by name (``pkg/<kind>/Name``)."""
