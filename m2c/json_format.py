"""The version of what m2c and moon write as JSON for programs (``--json``, ``--format json``, ``--log``).

Every object has it, as the first of its keys. It grows when a key goes, or means something else; a new key
does not change it, as readers pass over what they do not know.
"""

from __future__ import annotations

VERSION_KEY = "format_version"
VERSION = 1
