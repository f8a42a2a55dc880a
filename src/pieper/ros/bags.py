"""Bags: what was said on some topics, kept in a file (`pieper.ros.recording`), read (`pieper.ros.bag`), and said again (`pieper.ros.replay`).

Written are folders that ``ros2 bag`` reads; read are these, single files, and ROS 1 bags.
"""

from __future__ import annotations

from pieper.ros.bag import Bag, BagTopic, Message
from pieper.ros.recording import STORAGES, Recorder, record
from pieper.ros.replay import Replay, replay

__all__ = ["STORAGES", "Bag", "BagTopic", "Message", "Recorder", "Replay", "record", "replay"]
