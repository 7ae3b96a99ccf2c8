"""The part of rclpy that a node uses, with the messages of rosbags: rclpy is not on package indexes."""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)


class Parameter(NamedTuple):
    value: Any


class QoSProfile(NamedTuple):
    depth: int
    reliability: str


class ReliabilityPolicy:
    BEST_EFFORT = "best effort"


@dataclass
class Topics:
    """What runs around a node: its parameters, the messages that come, and what it sends and logs."""

    parameters: dict[str, Any] = field(default_factory=dict)
    coming: list[tuple[str, Any]] = field(default_factory=list)
    published: list[tuple[str, Any]] = field(default_factory=list)
    logged: list[str] = field(default_factory=list)
    subscribed: dict[str, tuple[type, Callable[[Any], None]]] = field(default_factory=dict)
    calls: list[str] = field(default_factory=list)

    def node(self) -> type:
        """Return the class of a node on these topics."""
        topics = self

        class Publisher:
            def __init__(self, kind: type, topic: str) -> None:
                self.kind, self.topic = kind, topic

            def publish(self, message: Any) -> None:
                assert type(message) is self.kind
                topics.published.append((self.topic, sent(message)))

        class Logger:
            def warning(self, text: str, *, throttle_duration_sec: float) -> None:
                topics.logged.append(text)

        class Node:
            def __init__(self, name: str) -> None:
                topics.calls.append(f"node {name}")

            def declare_parameter(self, name: str, default: Any) -> Parameter:
                value = topics.parameters.get(name, default)
                assert type(value) is type(default), "a parameter keeps its type"
                return Parameter(value)

            def create_subscription(self, kind: type, topic: str, take: Any, qos: QoSProfile | int) -> None:
                topics.subscribed[topic] = kind, take

            def create_publisher(self, kind: type, topic: str, qos: QoSProfile | int) -> Publisher:
                return Publisher(kind, topic)

            def get_logger(self) -> Logger:
                return Logger()

            def destroy_node(self) -> None:
                topics.calls.append("destroyed")

        return Node

    def spin(self, node: Any) -> None:
        """Bring the messages to their subscriptions, then interrupt as Ctrl-C does."""
        for topic, message in self.coming:
            kind, take = self.subscribed[topic]
            assert type(message) is kind
            take(sent(message))
        raise KeyboardInterrupt

    def modules(self) -> dict[str, ModuleType]:
        """Return the modules that a node imports."""
        given = {
            "rclpy": {"init": lambda: None, "spin": self.spin, "try_shutdown": lambda: None},
            "rclpy.node": {"Node": self.node()},
            "rclpy.qos": {"QoSProfile": QoSProfile, "ReliabilityPolicy": ReliabilityPolicy},
        }
        for kind in ("geometry_msgs", "sensor_msgs", "std_msgs"):
            given[kind] = {}
            names = [name for name in STORE.types if name.startswith(f"{kind}/msg/")]
            given[f"{kind}.msg"] = {name.rpartition("/")[2]: STORE.types[name] for name in names}
        modules = dict[str, ModuleType]()
        for name, content in given.items():
            modules[name] = ModuleType(name)
            vars(modules[name]).update(content)
        return modules


def sent(message: Any) -> Any:
    """Return a message after its way over the wire: a field of a wrong type does not survive it."""
    kind, fields = message.__msgtype__, dict(vars(message))
    for name in {"position", "velocity", "effort"} & fields.keys():
        assert all(type(each) is float for each in fields[name]) or isinstance(fields[name], np.ndarray)
        fields[name] = np.array(fields[name], np.float64)
    fields.pop("__msgtype__", None)
    return STORE.deserialize_cdr(STORE.serialize_cdr(type(message)(**fields), kind), kind)
