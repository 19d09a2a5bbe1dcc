"""What nuScenes' own devkit makes of a data set; runs in an environment of the devkit.

    PYTHON devkit_reference.py DATAROOT OUT.npz SWEEPS

Keys are KIND/SCENE/STAMP_US, the stamp that of the key frame's image: `lidar` and `radar` are (3, N) of column, row and
depth in the image, `sweeps` (3, N) of x y z in the camera's frame of so many radar sweeps.
"""

from __future__ import annotations

import sys

import numpy as np
from nuscenes import NuScenes
from nuscenes.utils.data_classes import RadarPointCloud


def main(root: str, out: str, sweeps: int) -> None:
    data = NuScenes(version="v1.0-mini", dataroot=root, verbose=False)
    RadarPointCloud.disable_filters()
    found = {}
    for sample in data.sample:
        scene = data.get("scene", sample["scene_token"])["name"]
        camera = sample["data"]["CAM_FRONT"]
        where = f"{scene}/{data.get('sample_data', camera)['timestamp']}"
        for kind, channel in (("lidar", "LIDAR_TOP"), ("radar", "RADAR_FRONT")):
            points, depth, _ = data.explorer.map_pointcloud_to_image(sample["data"][channel], camera)
            found[f"{kind}/{where}"] = np.vstack([points[:2], depth])
        cloud, _ = RadarPointCloud.from_file_multisweep(
            data, sample, "RADAR_FRONT", "CAM_FRONT", nsweeps=sweeps, min_distance=0.0
        )
        found[f"sweeps/{where}"] = cloud.points[:3]
    np.savez(out, **found)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
