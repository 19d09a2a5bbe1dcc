"""Opens the files of a bag with rosbags, within bounds."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import apsw
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from radcam_depth_ros.bags.chunks import BoundedMcapReader
from radcam_depth_ros.bags.errors import BagError
from radcam_depth_ros.bags.unpacking import MOST_BYTES, check_packed_files, mebibytes, unpack

_MOST_METADATA_BYTES = 16 * 1024**2  # of metadata.yaml: some 10,000 topics or split files
_TABLES = ("schema", "metadata", "topics", "message_definitions", "messages")


class BoundedSqliteReader(Sqlite3Reader):  # type: ignore[misc]  # rosbags is read without types
    """rosbags' reader of SQLite files, with bounds on messages; a column that is computed can be of any size."""

    def open(self) -> None:
        """Opens the file; BagError for tables that are computed, rosbags' and apsw's errors where it is damaged."""
        _check_tables(self.path)
        super().open()
        self.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, MOST_BYTES)

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """The messages in the order of their log times; BagError for one beyond the bound."""
        try:
            yield from super().messages(connections, start, stop)
        except apsw.TooBigError as error:
            raise BagError(
                f"a message of {self.path} is beyond the {mebibytes(MOST_BYTES)} that are read at once; "
                "leave its topic out when recording"
            ) from error


class BoundedFolder(DirectoryReader):  # type: ignore[misc]  # as above
    """rosbags' reader of rosbag2 folders, with bounds on compressed files and messages."""

    STORAGE_PLUGINS = {"mcap": BoundedMcapReader, "sqlite3": BoundedSqliteReader}  # noqa: RUF012  # rosbags' own

    metadata: Any
    _packs_messages = False

    def open(self) -> None:
        """Opens the folder; BagError beyond the bounds, rosbags' errors where it is damaged."""
        size = (self.path / "metadata.yaml").stat().st_size
        if size > _MOST_METADATA_BYTES:
            raise BagError(
                f"{self.path / 'metadata.yaml'} has {mebibytes(size)} of at most {mebibytes(_MOST_METADATA_BYTES)}; "
                "make it anew with `ros2 bag reindex`"
            )
        check_packed_files(self.path)
        super().open()
        self._packs_messages = self.metadata.compression_mode == "message"
        if self._packs_messages:  # else rosbags unpacks them, without a bound
            self.metadata = self.metadata._replace(compression_mode=None)

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes | bytearray]]:
        """The messages of all files; BagError beyond the bounds."""
        for connection, log_time_ns, content in super().messages(connections, start, stop):
            yield connection, log_time_ns, unpack(content, "zstd") if self._packs_messages else content


class BoundedReader(Reader):  # type: ignore[misc]  # as above
    """rosbags' reader of bags, with bounds on whatever is compressed in them."""

    STORAGE_PLUGINS = {"dir": BoundedFolder, ".mcap": BoundedMcapReader, ".db3": BoundedSqliteReader}  # noqa: RUF012


def _check_tables(path: Path) -> None:
    database = apsw.Connection(
        f"{path.resolve().as_uri()}?immutable=1", flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    )
    try:
        kinds = {name.lower(): kind for _, name, kind, *_ in database.execute("PRAGMA main.table_list")}
        for table in _TABLES:
            columns = list(database.execute(f"PRAGMA main.table_xinfo({table})"))
            if kinds.get(table, "table") != "table" or any(hidden for *_, hidden in columns):
                raise BagError(
                    f"the table {table} of {path} is computed instead of stored; record the bag again, or have it "
                    "converted where it is trusted"
                )
    finally:
        database.close()
