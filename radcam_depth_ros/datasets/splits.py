"""The splits of nuScenes: which scenes train, validate and test.

The official validation scenes by their numbers [Caesar2020]; the indices into scene.json that the public code of
[Singh2023] and its successors uses, which are the same scenes.
"""

from __future__ import annotations

from collections.abc import Sequence

from radcam_depth_ros.datasets.errors import DatasetError

SPLITS = ("train", "val", "test", "singh-train", "singh-val", "singh-test")
TEST_VERSION = "v1.0-test"
MINI_VERSION = "v1.0-mini"
_TRAINVAL_SCENES = 850
_VAL_NUMBERS = (
    *((3, 3), (12, 18), (35, 39), (92, 110), (221, 221), (268, 278), (329, 332), (344, 346), (519, 524)),
    *((552, 565), (625, 638), (770, 784), (794, 802), (904, 931), (962, 972), (1059, 1073)),
)
_MINI_VAL_NUMBERS = (103, 916)
_SINGH_INDICES = (
    *((2, 2), (11, 17), (34, 37), (74, 92), (171, 171), (214, 224), (257, 263), (409, 414), (436, 449)),
    *((481, 492), (598, 607), (614, 621), (690, 716), (729, 736), (799, 813)),
)


def split_of(scene: str, version: str) -> str:
    """The official split of a scene: train, val or test; empty for a name that has no number."""
    if version == TEST_VERSION:
        return "test"
    number = scene.removeprefix("scene-")
    if not number.isdecimal():
        return ""
    if version == MINI_VERSION:
        return "val" if int(number) in _MINI_VAL_NUMBERS else "train"
    return "val" if _within(int(number), _VAL_NUMBERS) else "train"


def scenes_of(split: str, scenes: Sequence[str], version: str) -> list[str]:
    """The scenes of a split, in their order.

    Args:
        split: One of `SPLITS`.
        scenes: The names of all scenes, in the order of scene.json.
        version: Name of the tables' folder.

    Raises:
        DatasetError: for an unknown split, or one that these tables do not have.
    """
    if split not in SPLITS:
        raise DatasetError(f"expected a split among {', '.join(SPLITS)}, got {split!r}")
    if split in ("singh-train", "singh-val"):
        if len(scenes) != _TRAINVAL_SCENES:
            raise DatasetError(
                f"expected the {_TRAINVAL_SCENES} scenes of v1.0-trainval for the split {split}, whose scenes are "
                f"given by their indices there, got {len(scenes)} in {version}; choose train or val"
            )
        wanted = split == "singh-val"
        return [name for index, name in enumerate(scenes) if _within(index, _SINGH_INDICES) == wanted]
    found = [name for name in scenes if split_of(name, version) == split.removeprefix("singh-")]
    if not found:
        there = sorted({split_of(name, version) for name in scenes} - {""})
        raise DatasetError(
            f"expected scenes of the split {split} in {version}, got those of {', '.join(there) or 'none'}; the test "
            f"scenes are in {TEST_VERSION}, all others in v1.0-trainval: set --version"
        )
    return found


def _within(number: int, ranges: Sequence[tuple[int, int]]) -> bool:
    return any(first <= number <= last for first, last in ranges)
