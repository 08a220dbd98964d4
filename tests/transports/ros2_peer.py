"""A node in a process of its own, for tests of how processes end: ``ros2_peer.py NAME HOW``.

HOW: ``serve`` answers until a signal comes, ``silent`` never answers, ``leave`` ends without close,
``publish`` sends a row of numbers to the node called ``node`` and ends at once.
"""

import os
import signal
import sys
import threading

from tests.transports import ros2_network
from transports.conformance import DOUBLE, NUMBERS, Answer, Number
from transports.ros2 import connect, transport

MESSAGES = 500
ARRIVED_S = 20.0
"""Where what is published comes before its reader is matched, DDS sends it again up to 3 s later."""

words = os.fdopen(os.dup(1), "w", buffering=1)
os.dup2(2, 1)  # Fast DDS prints what it complains of on stdout

name, how = sys.argv[1:]
ros2_network.load(ros2_network.built())
node = connect(name, {})
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: node.post(node.close))


def handle(request):
    if how != "silent":
        request.respond(Answer(2 * request.data.value))


node.serve(DOUBLE, handle)
publisher = node.publisher(NUMBERS)
node.announce()
if how == "leave":
    threading.Thread(target=node.spin, daemon=True).start()
    assert not node.wait_for_nodes([name], 20)
    print("left", file=words)
    sys.exit(0)
if how == "publish":
    threading.Thread(target=node.spin, daemon=True).start()
    assert not node.wait_for_nodes(["node"], 20)
    transport._LAST_WORDS_S = ARRIVED_S
    for value in range(MESSAGES):
        publisher.publish(Number(value))
    node.close()
    sys.exit(0)
node.post(lambda: print("spins", file=words))
node.spin()
node.close()
print("closed", file=words)
