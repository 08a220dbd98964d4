"""A node in a process of its own, for the tests beside this file: ``zenoh_peer.py ROLE ENDPOINT``."""

import sys

import msgspec

from transports.interface import Service, Topic
from transports.zenoh import connect


class Number(msgspec.Struct):
    data: int = 0


class AddRequest(msgspec.Struct):
    a: int = 0
    b: int = 0


class AddResponse(msgspec.Struct):
    total: int = 0


Number.__type_name__ = "std_msgs/msg/Int32"
ADD = Service("/adder/add", "test_interfaces/srv/Add", AddRequest, AddResponse)
COUNT = Topic("/adder/count", "std_msgs/msg/Int32", Number)


def main(role: str, endpoint: str) -> None:
    transport = connect("adder", {"endpoint": endpoint})
    publisher = transport.publisher(COUNT)
    kept = []

    def add(request) -> None:
        publisher.publish(Number(request.data.a))
        if role == "stuck":
            kept.append(request)
        else:
            request.respond(AddResponse(request.data.a + request.data.b))

    transport.serve(ADD, add)
    transport.announce()
    if role == "careless":  # ends without closing, with callbacks declared and a request open
        return
    transport.spin()


if __name__ == "__main__":
    main(*sys.argv[1:])
