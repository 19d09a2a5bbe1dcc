"""How the data sets in the schema of nuScenes differ, and what is taken of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from radcam_depth_ros.datasets.clouds import Columns, read_floats, read_pcd
from radcam_depth_ros.datasets.errors import DatasetError

IMAGES = ("keyframes", "all")
RADARS = ("front", "all")
WORLD_FRAME = "odom"
NUSCENES_RADAR = (
    *("x", "y", "z", "dyn_prop", "id", "rcs", "vx", "vy", "vx_comp", "vy_comp", "is_quality_valid", "ambig_state"),
    *("x_rms", "y_rms", "invalid_state", "pdh0", "vx_rms", "vy_rms"),
)
"""Fields of nuScenes' radar files."""


@dataclass(frozen=True)
class DatasetLayout:
    """A data set in the schema of nuScenes.

    Attributes:
        name: On the command line.
        title: In sentences.
        camera: Channel of the camera that is taken by default.
        radar: Channel of the radar ahead, that of the published protocols.
        lidar: Channel of the LiDAR that is the ground truth.
        ego_frame: Name of the ego frame: `base_footprint` where it lies on the road.
        has_splits: Whether the splits of nuScenes are its own.
        read_radar: Reads the bytes of a radar's file; the name is for sentences.
        read_lidar: Likewise of a LiDAR's.
    """

    name: str
    title: str
    camera: str
    radar: str
    lidar: str
    ego_frame: str
    has_splits: bool
    read_radar: Callable[[bytes, str], Columns]
    read_lidar: Callable[[bytes, str], Columns]

    def topic(self, channel: str, modality: str) -> str:
        """The topic of a channel, without what follows for its type: `/camera/front_left` of CAM_FRONT_LEFT."""
        if modality == "lidar":
            return "/lidar"
        return f"/{modality}/{channel.partition('_')[2].lower()}"


def _nuscenes_radar(content: bytes, name: str) -> Columns:
    return read_pcd(content, name, NUSCENES_RADAR)


def _nuscenes_lidar(content: bytes, name: str) -> Columns:
    return read_floats(content, name, ("x", "y", "z", "intensity", "ring"))


def _truckscenes_radar(content: bytes, name: str) -> Columns:
    return read_pcd(content, name, ("x", "y", "z", "vrel_x", "vrel_y", "vrel_z", "rcs"), exactly=False)


def _truckscenes_lidar(content: bytes, name: str) -> Columns:
    return read_pcd(content, name, ("x", "y", "z", "intensity"), exactly=False)


NUSCENES = DatasetLayout(
    name="nuscenes",
    title="nuScenes",
    camera="CAM_FRONT",
    radar="RADAR_FRONT",
    lidar="LIDAR_TOP",
    ego_frame="base_footprint",
    has_splits=True,
    read_radar=_nuscenes_radar,
    read_lidar=_nuscenes_lidar,
)
TRUCKSCENES = DatasetLayout(
    name="truckscenes",
    title="TruckScenes",
    camera="CAMERA_LEFT_FRONT",
    radar="RADAR_LEFT_FRONT",
    lidar="LIDAR_TOP_FRONT",
    ego_frame="base_link",  # its schema does not say that it lies on the road
    has_splits=False,
    read_radar=_truckscenes_radar,
    read_lidar=_truckscenes_lidar,
)
LAYOUTS = {layout.name: layout for layout in (NUSCENES, TRUCKSCENES)}
"""The data sets that can be imported, by their names."""


@dataclass(frozen=True)
class ImportOptions:
    """What is taken of a scene.

    Attributes:
        images: `keyframes` (2 Hz, those with annotations) or `all`.
        radars: `front`, the one of the published protocols, or `all`.
        cameras: Their channels; empty for the one ahead.
    """

    images: str = "all"
    radars: str = "front"
    cameras: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, known in (("images", IMAGES), ("radars", RADARS)):
            if getattr(self, name) not in known:
                raise DatasetError(f"expected {' or '.join(known)} for --{name}, got {getattr(self, name)!r}")

    def channels(self, layout: DatasetLayout) -> tuple[str, ...]:
        """The cameras that are taken."""
        return self.cameras or (layout.camera,)

    def takes(self, layout: DatasetLayout, channel: str, modality: str) -> bool:
        """Whether the readings of a channel are written."""
        if modality == "camera":
            return channel in self.channels(layout)
        if modality == "radar":
            return self.radars == "all" or channel == layout.radar
        return channel == layout.lidar

    def describe(self, layout: DatasetLayout) -> str:
        """The options in one line, by which a bag tells what it was made with."""
        cameras = ",".join(sorted(set(self.channels(layout))))
        return f"images={self.images} radars={self.radars} cameras={cameras}"
