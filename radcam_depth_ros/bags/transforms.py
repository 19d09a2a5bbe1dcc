"""The fixed transforms of a bag."""

from __future__ import annotations

from radcam_depth_ros.bags.reader import BagReader
from radcam_depth_ros.geometry import TransformTree
from radcam_depth_ros.messages import decode_transforms


def read_static_transforms(bag: BagReader, topic: str = "/tf_static") -> TransformTree:
    """The whole of a bag's `/tf_static`, wherever in the bag its messages are; empty for a bag without that topic.

    Raises:
        BagError: for a damaged bag.
        MessageError: for a transform that is none.
        GeometryError: for transforms that close a cycle.
    """
    tree = TransformTree()
    if any(info.name == topic for info in bag.topics):
        for item in bag.messages([topic]):
            for link in decode_transforms(item.message):
                tree.set(link.parent_frame, link.child_frame, link.parent_from_child)
    return tree
