"""Watch a running system without touching it.

The names in ``__all__`` are the interface; everything else may change. A system that runs is watched by a
:class:`Monitor`. Here it runs in a simulated world, in virtual time:

>>> import m2c, moon
>>> from transports import SimulatedWorld
>>> system = m2c.read_system("examples/lab_tour/system.xml")
>>> properties = moon.PropertySet.from_files("examples/lab_tour/properties.yaml", system=system)
>>> world = SimulatedWorld(seed=1)
>>> verdicts = []
>>> monitor = moon.Monitor(world.connect("monitor"), system, properties, on_verdict=verdicts.append)
>>> monitor.start()
>>> world.run_for(0.01)
>>> m2c.simulate(system, world).run(20.0)
>>> monitor.violations
0
>>> {status.verdict for status in monitor.statuses()}
{'conforming'}

A recorded run is checked in the same way:

>>> result = moon.check_recording("tests/recordings/zenoh-T3.mcap", system, properties)
>>> [found.verdict.machine for found in result.violated]
['P1', 'BatteryLevelSkill']
>>> result.violated[1].verdict.explanation.observed
'response on /BatteryLevelSkill/tick {status: FAILURE (1), is_ok: true}'

Besides its models and properties, a run is judged by whatever is a :class:`Judge`. This one knows that an
empty battery stays empty:

>>> class StaysEmpty(moon.Judge):
...     name = "stays empty"
...     was_empty = False
...
...     def concerns(self, channel, source, kind):
...         return (channel, kind) == ("/BatteryLevelSkill/tick", "response_sent")
...
...     def observe(self, seen):
...         is_empty = seen.data["status"] == 1
...         if self.was_empty and not is_empty:
...             why = "it is not empty any more"
...             yield moon.Verdict.of(self.name, moon.Outcome.VIOLATED, seen.stamp_ns, why)
...         self.was_empty = is_empty
...
...     def gap(self, gap):
...         self.was_empty = False  # that it was charged may not have been received
...         return ()
>>> result = moon.check_recording("tests/recordings/zenoh-T3.mcap", judges=[StaysEmpty])
>>> [(found.verdict.machine, found.verdict.reason) for found in result.violated]
[('stays empty', 'it is not empty any more')]

What was recorded is read, and given to the oracle of one machine or to anything else, by hand:

>>> from transports import Observation
>>> oracle = moon.Oracle(system.node("BatteryLevelSkill"), library=system.library)
>>> recording = moon.Recording.open("tests/recordings/zenoh-T3.mcap", system.library)
>>> found = [
...     verdict
...     for entry in recording.entries()
...     if isinstance(entry, Observation)
...     for verdict in oracle.feed(entry)
... ]
>>> str(found[-1].outcome)
'violated'
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from moon.api import Monitor, check_recording
    from moon.judge import Gap, Judge, NodeChange
    from moon.monitor.subject import NothingLeftError
    from moon.offline.engine import EmptyRecordingError
    from moon.oracle.oracle import Oracle
    from moon.properties.monitor import PropertySet, TimeOrderError
    from moon.recording.reader import Recording, RecordingError
    from moon.verdict import Outcome, Verdict

__all__ = [
    "EmptyRecordingError",
    "Gap",
    "Judge",
    "Monitor",
    "NodeChange",
    "NothingLeftError",
    "Oracle",
    "Outcome",
    "PropertySet",
    "Recording",
    "RecordingError",
    "TimeOrderError",
    "Verdict",
    "check_recording",
]

_HOMES = {
    "EmptyRecordingError": "moon.offline.engine",
    "Gap": "moon.judge",
    "Judge": "moon.judge",
    "Monitor": "moon.api",
    "NodeChange": "moon.judge",
    "NothingLeftError": "moon.monitor.subject",
    "Oracle": "moon.oracle.oracle",
    "Outcome": "moon.verdict",
    "PropertySet": "moon.properties.monitor",
    "Recording": "moon.recording.reader",
    "RecordingError": "moon.recording.reader",
    "TimeOrderError": "moon.properties.monitor",
    "Verdict": "moon.verdict",
    "check_recording": "moon.api",
}
"""Where a name is defined. It is imported when it is first used: the command line stays quick."""


def _refuse_stale(package: Path) -> None:
    """In a clone: no module may have been changed since it was compiled (``make compiled``).

    Raises:
        ImportError: one was; Python would run what it was before.
    """
    library = next(package.glob("compiled__mypyc*"), None)
    if library is None or not (package.parent / "setup.py").exists():
        return
    made = library.stat().st_mtime_ns
    for module in package.rglob(f"*{library.suffix}"):
        source = module.with_name(module.name.partition(".")[0] + ".py")
        if source.exists() and source.stat().st_mtime_ns > made:
            raise ImportError(
                f"{source} was changed after it was compiled: `make compiled` compiles it again, "
                "`make interpreted` runs what is written"
            )


_refuse_stale(Path(__file__).parent)
_refuse_stale(Path(__file__).parents[1] / "transports")


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
