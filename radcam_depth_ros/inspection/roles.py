"""Roles of a bag's topics, also where some are missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from radcam_depth_ros.bags import BagError, TopicInfo
from radcam_depth_ros.bags.topics import TopicChooser

FoundT = TypeVar("FoundT")


@dataclass(frozen=True)
class Roles:
    """Topics by their role; None or empty where there is none.

    Attributes:
        image: The camera's.
        camera_info: Its calibration.
        radars: The radars' clouds and scans.
        lidar: For ground truth.
        depth: Exact depth.
        classes: Class images.
        odometry: The vehicle's motion.
        tf_static: Fixed transforms.
        tf: Moving transforms.
        beside: Clouds of radars that are left out, each with the scan in its namespace that is taken.
        lacks: A sentence for each of camera, camera_info and radars that is missing.
    """

    image: str | None
    camera_info: str | None
    radars: tuple[str, ...]
    lidar: str | None
    depth: str | None
    classes: str | None
    odometry: str | None
    tf_static: str | None
    tf: str | None
    beside: Mapping[str, str]
    lacks: tuple[str, ...]

    @classmethod
    def of(cls, topics: Iterable[TopicInfo]) -> Roles:
        """The roles of a bag's topics, chosen as `find_topics` does."""
        chooser, lacks = TopicChooser(topics), []

        def attempt(find: Callable[[], FoundT], otherwise: FoundT) -> FoundT:
            try:
                return find()
            except BagError as error:
                lacks.append(str(error))
                return otherwise

        image = attempt(chooser.find_image, "")
        camera_info = attempt(lambda: chooser.find_camera_info(image), "")
        no_radars: tuple[str, ...] = ()
        radars = attempt(chooser.find_radars, no_radars)
        return cls(
            image or None,
            camera_info or None,
            radars,
            chooser.find_lidar(radars),
            chooser.find_depth(),
            chooser.find_classes(),
            chooser.find_odometry(),
            chooser.find_transforms("tf_static"),
            chooser.find_transforms("tf"),
            chooser.clouds_beside_scans(),
            tuple(lacks),
        )

    def role_of(self, topic: str) -> str:
        """In words; empty for nothing."""
        words: dict[str | None, str] = {
            self.image: "camera",
            self.camera_info: "camera_info",
            self.lidar: "ground truth (LiDAR)",
            self.depth: "ground truth (depth)",
            self.classes: "classes",
            self.odometry: "odometry",
            self.tf_static: "transforms",
            self.tf: "moving transforms",
            **dict.fromkeys(self.radars, "radar"),
        }
        return words.get(topic, "")
