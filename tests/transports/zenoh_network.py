"""Nodes, processes and bare sessions on one Zenoh endpoint, for the tests beside this file."""

import importlib.util
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import zenoh

from transports.interface import TransportError
from transports.zenoh import connect
from transports.zenoh_link import session

PEER = Path(__file__).with_name("zenoh_peer.py")
_spec = importlib.util.spec_from_file_location("zenoh_peer", PEER)
peer = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(peer)

WAIT_S = 20.0
"""How long a test waits for what must happen; only a failing test waits that long."""


def eventually(condition):
    """Wait for ``condition``, about something that has no event to wait for."""
    pause, deadline = threading.Event(), time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        pause.wait(0.01)


class Inbox(list):
    """What a handler heard; ``wait(n)`` until there are n."""

    def __init__(self):
        super().__init__()
        self._changed = threading.Condition()

    def __call__(self, *item):
        with self._changed:
            self.append(item[0] if len(item) == 1 else item)
            self._changed.notify_all()

    def wait(self, count=1):
        with self._changed:
            assert self._changed.wait_for(lambda: len(self) >= count, WAIT_S), list(self)
        return self


def close_and(node, work, refused):
    """In a handler of ``node``: another thread closes it, and then ``work`` is done. ``refused`` gets why not."""
    closing = threading.Thread(target=node.close)
    closing.start()
    closing.join()
    try:
        work()
    except TransportError as error:
        refused(str(error))
        raise


class Network:
    """Nodes of one test around one endpoint; the first to come listens on it."""

    def __init__(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        self._nodes, self._threads, self._processes, self._sessions = [], [], [], []

    def node(self, name, **options):
        place = "endpoint" if self._nodes else "listen"
        transport = connect(name, {place: self.endpoint} | options)
        thread = threading.Thread(target=transport.spin)
        thread.start()
        self._nodes.append(transport)
        self._threads.append(thread)
        return transport

    def bare(self):
        opened = session.open_session({"endpoint": self.endpoint})
        self._sessions.append(opened)
        return opened

    def process(self, role):
        process = subprocess.Popen([sys.executable, str(PEER), role, self.endpoint])
        self._processes.append(process)
        return process

    def close(self):
        for opened in self._sessions:
            opened.close()
        for transport in reversed(self._nodes):
            transport.close()
        for thread in self._threads:
            thread.join(WAIT_S)
            assert not thread.is_alive()
        for process in self._processes:
            process.kill()
            process.wait()


def linked(bare, key):
    """A publisher of a bare session whose publications somebody hears; none is lost on the way."""
    publisher = bare.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    eventually(lambda: publisher.matching_status.matching)
    return publisher
