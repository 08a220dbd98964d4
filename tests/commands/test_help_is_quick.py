"""What ``--help`` of a command imports: neither models nor what reads them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from m2c.cli import _COMMANDS

SLOW = ("m2c.model", "msgspec", "lxml.etree", "esprima", "rosbags", "behaviortreepy")
PROGRAM = """
import sys
from m2c.cli import main
try:
    main([sys.argv[1], "--help"])
except SystemExit:
    print(*[name for name in sys.argv[2:] if name in sys.modules], file=sys.stderr)
"""


@pytest.mark.parametrize("name", _COMMANDS)
def test_help_reads_no_models(name: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM, name, *SLOW], capture_output=True, text=True, check=True
    )
    assert ran.stdout.startswith("Usage:")
    assert ran.stderr.split() == []
