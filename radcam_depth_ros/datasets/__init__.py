"""Imports public data sets: their tables and files become bags, one a scene; writes drives in their schema."""

from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.exporting import export_nuscenes
from radcam_depth_ros.datasets.importing import ImportedScene, import_scenes, plan_import, some_names
from radcam_depth_ros.datasets.layout import LAYOUTS, DatasetLayout, ImportOptions
from radcam_depth_ros.datasets.splits import SPLITS

__all__ = [
    "LAYOUTS",
    "SPLITS",
    "DatasetError",
    "DatasetLayout",
    "ImportOptions",
    "ImportedScene",
    "export_nuscenes",
    "import_scenes",
    "plan_import",
    "some_names",
]
