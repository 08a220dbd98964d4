"""An ordinary rclpy node, which knows nothing of the transport."""

from __future__ import annotations

import threading

from transports.networks import PATIENCE_S


class Bare:
    """An rclpy node as anybody writes it, spinning on a thread."""

    def __init__(self, name: str, namespace: str = "") -> None:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import MultiThreadedExecutor

        self.context = Context()
        self.context.init(args=[])
        self.node = rclpy.create_node(name, context=self.context, namespace=namespace or None)
        self.executor = MultiThreadedExecutor(2, context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin)
        self.thread.start()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            self.executor.spin()
        except ExternalShutdownException:
            return

    def close(self) -> None:
        self.executor.shutdown()
        self.thread.join(PATIENCE_S)
        self.node.destroy_node()
        self.context.try_shutdown()
