"""``python -m transports.zenoh.router``: see :mod:`transports.zenoh_link.router`."""

from __future__ import annotations

import sys

from transports.zenoh_link.router import main

if __name__ == "__main__":
    sys.exit(main())
