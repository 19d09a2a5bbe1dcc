"""Cached drives in storage, which many machines make and many read.

Each is a folder of the same three files as on a disk. The card is written last: a drive is whole when it is there.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from radcam_depth_ros.storage import RemoteFolder
from radcam_depth_ros.training.data.samples import CARD, INDEX_FILE, SAMPLES, CachedDrive
from radcam_depth_ros.training.errors import TrainingError


@dataclass(frozen=True)
class SharedCache:
    """Cached drives at a URL.

    Attributes:
        url: Of the folder that holds their folders.
    """

    url: str

    def fetch(self, name: str, folder: Path) -> bool:
        """Copies a drive into an empty folder on the disk; False where there is none that is whole.

        Files go to the disk block by block, so that memory does not depend on their size.

        Raises:
            StorageError: when it cannot be read, or the disk has no room for it.
        """
        if not RemoteFolder(f"{self.url}/{name}").fetch((CARD, INDEX_FILE, SAMPLES), folder):
            return False
        try:
            CachedDrive(folder)
        except TrainingError:  # damaged: it is built anew and replaced
            for file in folder.iterdir():
                file.unlink()
            return False
        return True

    def put(self, folder: Path, name: str) -> None:
        """Writes a drive.

        Raises:
            StorageError: when it cannot be written.
        """
        RemoteFolder(f"{self.url}/{name}").put(folder, (SAMPLES, INDEX_FILE, CARD))
