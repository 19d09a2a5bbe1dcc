"""Storage: bags and folders on a disk, or anywhere that fsspec reaches: s3://, gs:// and so on."""

from radcam_depth_ros.storage.bags import content_at, find_places, remote_stamp, staged, stamp_at
from radcam_depth_ros.storage.errors import StorageError
from radcam_depth_ros.storage.folders import Folder, RemoteFolder, folder_at
from radcam_depth_ros.storage.transfers import is_remote, place_of

__all__ = [
    "Folder",
    "RemoteFolder",
    "StorageError",
    "content_at",
    "find_places",
    "folder_at",
    "is_remote",
    "place_of",
    "remote_stamp",
    "staged",
    "stamp_at",
]
