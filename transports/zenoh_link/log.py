"""Where everything on Zenoh logs."""

from __future__ import annotations

import logging

LOG = logging.getLogger("transports.zenoh")
