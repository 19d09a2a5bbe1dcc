"""Finds the topics of the camera, its radars and other sensors by type and name."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from radcam_depth_ros.bags.definitions import RADAR_SCAN
from radcam_depth_ros.bags.errors import BagError, nearest
from radcam_depth_ros.bags.reader import TopicInfo

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA_INFO_TYPES = ("sensor_msgs/msg/CameraInfo",)
CLOUD_TYPES = ("sensor_msgs/msg/PointCloud2",)
RADAR_TYPES = (*CLOUD_TYPES, RADAR_SCAN)
ODOMETRY_TYPES = ("nav_msgs/msg/Odometry",)
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage",)

_RADAR_HINTS = (
    "radar",
    "ars408",
    "ars430",
    "ars540",
    "ars548",
    "srr",
    "mmwave",
    "smartmicro",
    "umrr",
    "oculii",
    "arbe",
)
_LIDAR_HINTS = (
    "lidar",
    "velodyne",
    "vlp",
    "ouster",
    "hesai",
    "pandar",
    "livox",
    "rslidar",
    "robosense",
    "points_raw",
    "laser",
)
_NO_CAMERA_HINTS = (
    "depth",
    "semi_dense",
    "semantic",
    "class",
    "segment",
    "confidence",
    "preview",
    "ground_truth",
    "mask",
    "disparity",
)
_SET_BY = {
    "image": "image_topic, or --image",
    "camera_info": "camera_info_topic",
    "radar": "radar_topics, or --radar",
    "lidar": "--lidar",
    "depth": "--depth",
    "classes": "another one",
    "odometry": "odometry_topic",
}
"""The node's parameter, or the option, that names a topic of each role."""
_CLASS_HINTS = ("class", "semantic", "segmentation")


@dataclass(frozen=True)
class SensorTopics:
    """The sensors' topics in a bag; None where it has none.

    Attributes:
        image: The camera's Image or CompressedImage.
        camera_info: Its CameraInfo.
        radars: The radars' PointCloud2 or RadarScan, sorted; at least one.
        lidar: A LiDAR's PointCloud2, for ground truth.
        depth: Exact depth as an Image, from a simulator.
        classes: The class of each pixel as an Image.
        odometry: The vehicle's motion.
        tf_static: The fixed transforms.
        tf: The moving transforms.
    """

    image: str
    camera_info: str
    radars: tuple[str, ...]
    lidar: str | None = None
    depth: str | None = None
    classes: str | None = None
    odometry: str | None = None
    tf_static: str | None = None
    tf: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """All topics that there are."""
        singles = (self.image, self.camera_info, self.lidar, self.depth, self.classes, self.odometry)
        transforms = (self.tf_static, self.tf)
        return tuple(name for name in (*singles[:2], *self.radars, *singles[2:], *transforms) if name is not None)


def find_topics(
    topics: Iterable[TopicInfo],
    *,
    image: str | None = None,
    camera_info: str | None = None,
    radars: Sequence[str] | None = None,
    lidar: str | None = None,
    depth: str | None = None,
    classes: str | None = None,
    odometry: str | None = None,
    preferred: Sequence[str] = (),
    image_types: Sequence[str] = IMAGE_TYPES,
    of: str = "the bag",
) -> SensorTopics:
    """Tells a bag's sensors from their topics; what is given by name is taken when it exists and fits.

    Of several cameras the one with its own camera_info is taken, before that the one that looks ahead by its name.

    Args:
        topics: `BagReader.topics`.
        image: Name of the camera's topic; found when None, as for all others.
        camera_info: Name of its camera_info.
        radars: Names of the radars' topics; empty for none at all.
        lidar: Name of the LiDAR's topic.
        depth: Name of the exact depth images.
        classes: Name of the class images.
        odometry: Name of the odometry.
        preferred: Of images and radars that are not named: these are taken where they are there.
        image_types: Types of images that may be the camera's.
        of: What has the topics, for the sentence on what it lacks.

    Raises:
        BagError: when the bag has no camera, camera_info or radar, or not what is asked for by name.
    """
    chooser = TopicChooser(topics, of, preferred, image_types)
    image = chooser.named("image", image, image_types) or chooser.find_image()
    camera_info = chooser.named("camera_info", camera_info, CAMERA_INFO_TYPES) or chooser.find_camera_info(image)
    if radars is None:
        found_radars = chooser.find_radars()
    else:
        found_radars = tuple(chooser.named("radar", name, RADAR_TYPES) or name for name in radars)
    return SensorTopics(
        image=image,
        camera_info=camera_info,
        radars=found_radars,
        lidar=chooser.named("lidar", lidar, CLOUD_TYPES) or chooser.find_lidar(found_radars),
        depth=chooser.named("depth", depth, IMAGE_TYPES[:1]) or chooser.find_depth(),
        classes=chooser.named("classes", classes, IMAGE_TYPES) or chooser.find_classes(),
        odometry=chooser.named("odometry", odometry, ODOMETRY_TYPES) or chooser.find_odometry(),
        tf_static=chooser.find_transforms("tf_static"),
        tf=chooser.find_transforms("tf"),
    )


class TopicChooser:
    """The topics of a bag that hold messages, and the choices among them, one by one.

    Args:
        topics: `BagReader.topics`.
        of: What has them, for sentences on what it lacks.
        preferred: Images and radars that are found before all others.
        image_types: Types of images that may be the camera's.
    """

    def __init__(
        self,
        topics: Iterable[TopicInfo],
        of: str = "the bag",
        preferred: Sequence[str] = (),
        image_types: Sequence[str] = IMAGE_TYPES,
    ) -> None:
        self._of, self._preferred, self._image_types = of, tuple(preferred), tuple(image_types)
        self._topics = [topic for topic in topics if topic.count > 0]

    def of_type(self, types: Collection[str]) -> list[str]:
        """Names of the topics of some types."""
        return [topic.name for topic in self._topics if topic.type_name in types]

    def named(self, role: str, name: str | None, types: Sequence[str]) -> str | None:
        """The name as it is recorded, None for None; BagError when no topic of these types has it."""
        if name is None:
            return None
        fitting = self.of_type(types)
        found = next((topic for topic in fitting if topic.strip("/") == name.strip("/")), None)
        if found is None:
            raise BagError(
                f"{self._of} has no {role} topic {name} of {' or '.join(types)}; it has {nearest(name, fitting)}; set "
                f"{_SET_BY[role]}"
            )
        return found

    def find_image(self) -> str:
        """The camera's images; BagError when there are none."""
        fitting = self.of_type(self._image_types)
        known = next((name for name in self._preferred if name in fitting), None)
        if known is not None:
            return known
        images = [name for name in fitting if not _has(name, _NO_CAMERA_HINTS)]
        if not images:
            raise self._lacks("camera image", self._image_types)
        infos = self.of_type(CAMERA_INFO_TYPES)
        with_info = [name for name in images if _sibling_info(name, infos)]
        raw = set(self.of_type(IMAGE_TYPES[:1]))
        # image_transport's parameters may leave the same camera raw and compressed: raw costs no quality
        return min(with_info or images, key=lambda name: (not _has(name, ("front",)), name not in raw, _shortest(name)))

    def find_camera_info(self, image: str) -> str:
        """The calibration of a camera; BagError when there is none, or several and none beside the images."""
        infos = self.of_type(CAMERA_INFO_TYPES)
        if not infos:
            raise self._lacks("camera_info", CAMERA_INFO_TYPES)
        sibling = _sibling_info(image, infos)
        if sibling is None and len(infos) > 1:
            raise BagError(
                f"{self._of} has no camera_info beside {image} but {', '.join(sorted(infos))}; name the one to use"
            )
        return sibling or infos[0]

    def find_radars(self) -> tuple[str, ...]:
        """The radars' clouds and scans, sorted; BagError when there are none.

        Of a driver that publishes both in one namespace the scan is taken: a cloud may lack a quantity.
        """
        fitting = self.of_type(RADAR_TYPES)
        known = tuple(name for name in self._preferred if name in fitting)
        if known:
            return known
        clouds, scans = self._radars()
        radars = tuple(sorted((*scans, *(name for name in clouds if not _beside(name, scans)))))
        if not radars:
            raise self._lacks("radar", RADAR_TYPES)
        return radars

    def clouds_beside_scans(self) -> dict[str, str]:
        """The radars' clouds that are not taken, each with the scan in its namespace that is taken."""
        clouds, scans = self._radars()
        return {cloud: scan for cloud in clouds for scan in _beside(cloud, scans)[:1]}

    def _radars(self) -> tuple[list[str], list[str]]:
        """Clouds that are a radar's by their name, and scans."""
        clouds = [name for name in self.of_type(CLOUD_TYPES) if _has(name, _RADAR_HINTS)]
        return clouds, self.of_type((RADAR_SCAN,))

    def find_lidar(self, radars: tuple[str, ...]) -> str | None:
        """A LiDAR's cloud; None when there is none."""
        clouds = [name for name in self.of_type(CLOUD_TYPES) if name not in radars and not _has(name, _RADAR_HINTS)]
        return min((name for name in clouds if _has(name, _LIDAR_HINTS)), key=_shortest, default=None)

    def find_depth(self) -> str | None:
        """Exact depth images; None when there are none."""
        return self._find_ground_truth(("depth",))

    def find_classes(self) -> str | None:
        """Class images; None when there are none."""
        return self._find_ground_truth(_CLASS_HINTS)

    def find_odometry(self) -> str | None:
        """The vehicle's motion; None when there is none."""
        return min(self.of_type(ODOMETRY_TYPES), key=_shortest, default=None)

    def _find_ground_truth(self, hints: tuple[str, ...]) -> str | None:
        images = [name for name in self.of_type(IMAGE_TYPES[:1]) if _has(name, hints)]
        exact = [name for name in images if _has(name, ("ground_truth",))]
        # A plain depth camera counts too; the node's own outputs do not, which end in image_rect or confidence.
        measured = [name for name in images if _has(name.rsplit("/", 1)[-1], hints)]
        return min(exact or measured, key=_shortest, default=None)

    def find_transforms(self, last_part: str) -> str | None:
        """Transforms on `tf` or `tf_static`; None when there are none."""
        names = [name for name in self.of_type(TRANSFORM_TYPES) if name.rsplit("/", 1)[-1] == last_part]
        return min(names, key=_shortest, default=None)

    def _lacks(self, what: str, types: Sequence[str]) -> BagError:
        holds = ", ".join(f"{topic.name} ({topic.type_name})" for topic in self._topics) or "no messages"
        return BagError(
            f"{self._of} has no {what} ({' or '.join(types)}), it holds {holds}; use another "
            f"{self._of.removeprefix('the ')} or name the topic"
        )


def _has(name: str, hints: Iterable[str]) -> bool:
    return any(hint in name.lower() for hint in hints)


def _beside(name: str, others: Iterable[str]) -> list[str]:
    """The others in a topic's namespace; none at the root."""
    namespace = name.rpartition("/")[0]
    return [other for other in others if namespace and other.rpartition("/")[0] == namespace]


def _shortest(name: str) -> tuple[int, str]:
    return len(name), name


def _sibling_info(image: str, infos: Collection[str]) -> str | None:
    """The camera_info beside an image topic, also when a transport's name follows it (`image_raw/compressed`)."""
    parent = image.rpartition("/")[0]
    candidates = (f"{parent}/camera_info", f"{parent.rpartition('/')[0]}/camera_info")
    return next((name for name in candidates if name in infos), None)
