"""Who announces nodes in many namespaces, in which nothing happens: ``python strangers.py ENDPOINT COUNT``.

It says that it has done so, and stays until its standard input ends.
"""

from __future__ import annotations

import json
import sys

import zenoh

NODES = ("BatteryLevelSkill", "policy", "n" * 250)


def main(endpoint: str, count: int) -> None:
    """Announce ``count`` robots, and one with a name of 60 KB."""
    config = zenoh.Config()
    for key, value in {
        "connect/endpoints": [endpoint],
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    zid = session.info.zid()
    spaces = [*(f"robots/s{number}" for number in range(count)), "robots/" + "x" * 60_000]
    declared = [
        session.liveliness().declare_token(f"{space}/@m2c/node/{zid}/{NODES[number % 3]}/1")
        for number, space in enumerate(spaces)
    ]
    print(len(declared), flush=True)
    sys.stdin.read()
    session.close()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
