"""The bags of an evaluation: looked at before they are read, named apart, and read frame by frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from radcam_depth_ros.bags import BagReader, read_scenario
from radcam_depth_ros.drive import DriveSettings, Sample, read_samples
from radcam_depth_ros.evaluation.drive import Drive
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.frame import CameraModel


@dataclass(frozen=True)
class DriveSource:
    """A bag to read.

    Attributes:
        bag: Where it is.
        frames: How many of its images are read.
        limit: Where reading it stops; None for its end.
        scenario: As `bags.read_scenario` gives it.
    """

    bag: Path
    frames: int
    limit: int | None
    scenario: Mapping[str, str]

    @classmethod
    def find(cls, bag: Path, settings: DriveSettings, limit: int | None = None) -> DriveSource:
        """Looks at a bag; RadcamDepthError where it lacks a sensor or has no ground truth."""
        with BagReader(bag) as reader:
            topics = settings.find_topics(reader)
            if topics.depth is None and topics.lidar is None:
                raise EvaluationError(
                    f"expected ground truth in {bag}, got {', '.join(topics.names)}; what would serve is a LiDAR "
                    "(sensor_msgs/PointCloud2, see --lidar) or true depth images (sensor_msgs/Image of 32FC1 or 16UC1, "
                    "see --depth)"
                )
            frames = reader.count([topics.image])
            scenario = read_scenario(reader)
        return cls(bag, min(frames, limit or frames), limit, scenario)

    @property
    def name(self) -> str:
        """The bag's own name."""
        return name_of(self.bag)

    def drive(
        self, name: str, settings: DriveSettings, ready: Callable[[CameraModel], None], advance: Callable[[], None]
    ) -> Drive:
        """The drive to be evaluated.

        Args:
            name: What its frames are filed under.
            settings: How the bag is read.
            ready: Called before a frame with its camera: what is built once for a camera is built here, so that times
                are those of a running node.
            advance: Called after each frame.
        """

        def samples() -> Iterator[Sample]:
            for sample in islice(read_samples(self.bag, settings), self.limit):
                ready(sample.frame.camera)
                yield sample
                advance()

        return Drive(samples(), name, self.scenario)


def name_of(bag: Path) -> str:
    """A bag's own name, without the suffix of a file."""
    return bag.stem if bag.is_file() else bag.name


def distinct_names(names: Sequence[str], places: Iterable[str]) -> list[str]:
    """What the frames of some bags are filed under: the bag's own name, or its place where several have that name."""
    taken = Counter(names)
    return [name if taken[name] == 1 else place for name, place in zip(names, places, strict=True)]


def bags_json(bags: Sequence[str]) -> dict[str, object]:
    """The places of bags as the JSON of an evaluation has them."""
    single = {"bag": bags[0]} if len(bags) == 1 else {}
    return {**single, "bags": list(bags)}


def listed(bags: Sequence[str], names: Sequence[str]) -> str:
    """Bags in a few words."""
    if len(bags) == 1:
        return bags[0]
    some = ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:3])} ... {names[-1]}"
    return f"{len(bags)} bags: {some}"
