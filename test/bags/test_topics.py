from __future__ import annotations

import pytest

from radcam_depth_ros.bags import BagError, BagReader, SensorTopics, TopicInfo, find_topics

IMAGE = "sensor_msgs/msg/Image"
JPEG = "sensor_msgs/msg/CompressedImage"
INFO = "sensor_msgs/msg/CameraInfo"
CLOUD = "sensor_msgs/msg/PointCloud2"
SCAN = "radar_msgs/msg/RadarScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

SIMULATED = {
    "/camera/image_raw/compressed": JPEG,
    "/camera/camera_info": INFO,
    "/ground_truth/classes": IMAGE,
    "/ground_truth/depth": IMAGE,
    "/lidar/points": CLOUD,
    "/odom": ODOMETRY,
    "/radar/points": CLOUD,
    "/radar_4d/points": CLOUD,
    "/tf": TRANSFORMS,
    "/tf_static": TRANSFORMS,
}
MINIMAL = {"/camera/image_raw": IMAGE, "/camera/camera_info": INFO, "/radar/points": CLOUD}


def bag(types: dict[str, str], empty: tuple[str, ...] = ()) -> list[TopicInfo]:
    return [TopicInfo(name, kind, 0 if name in empty else 9) for name, kind in types.items()]


def test_a_simulated_drive():
    topics = find_topics(bag(SIMULATED))
    assert topics == SensorTopics(
        image="/camera/image_raw/compressed",
        camera_info="/camera/camera_info",
        radars=("/radar/points", "/radar_4d/points"),
        lidar="/lidar/points",
        depth="/ground_truth/depth",
        classes="/ground_truth/classes",
        odometry="/odom",
        tf_static="/tf_static",
        tf="/tf",
    )
    assert sorted(topics.names) == sorted(SIMULATED)


@pytest.mark.parametrize("sensors", [MINIMAL, SIMULATED], ids=["raw", "compressed"])
def test_a_replayed_drive_does_not_take_its_own_outputs_for_sensors(sensors):
    outputs = {
        "/depth/image_rect": IMAGE,
        "/depth/camera_info": INFO,
        "/depth/confidence": IMAGE,
        "/depth/preview": IMAGE,
        "/depth/points": CLOUD,
        "/semi_dense/image_rect": IMAGE,
        "/semi_dense/camera_info": INFO,
        "/semantics/image": IMAGE,
    }
    assert find_topics(bag({**outputs, **sensors})) == find_topics(bag(sensors))


def test_the_real_drive(astyx_val):
    with BagReader(astyx_val) as reader:
        topics = find_topics(reader.topics)
    assert topics == SensorTopics(
        image="/camera_front/image_raw/compressed",
        camera_info="/camera_front/camera_info",
        radars=("/radar_front/points",),
        lidar="/lidar/points",
        tf_static="/tf_static",
    )


@pytest.mark.parametrize(
    ("types", "image", "info"),
    [
        # nuScenes: six cameras, the front one looks ahead
        (
            {
                f"/CAM_{place}/{name}": kind
                for place in ("BACK", "FRONT_LEFT", "FRONT", "FRONT_RIGHT")
                for name, kind in {"image_rect_compressed": JPEG, "camera_info": INFO}.items()
            },
            "/CAM_FRONT/image_rect_compressed",
            "/CAM_FRONT/camera_info",
        ),
        # one camera, raw and compressed
        (
            {"/cam/image/compressed": JPEG, "/cam/image": IMAGE, "/cam/camera_info": INFO},
            "/cam/image",
            "/cam/camera_info",
        ),
        # the camera with its own camera_info, although another looks to the front
        ({"/front/image": IMAGE, "/side/image": IMAGE, "/side/camera_info": INFO}, "/side/image", "/side/camera_info"),
        # at the root
        ({"/image_raw": IMAGE, "/camera_info": INFO}, "/image_raw", "/camera_info"),
        # no sibling, but only one to choose
        ({"/cam/image": IMAGE, "/calibration/front": INFO}, "/cam/image", "/calibration/front"),
    ],
)
def test_the_camera_and_its_camera_info(types, image, info):
    topics = find_topics(bag({**types, "/radar": CLOUD}))
    assert (topics.image, topics.camera_info) == (image, info)


def test_several_camera_infos_without_a_sibling_are_not_guessed():
    types = {"/cam/image": IMAGE, "/a/camera_info": INFO, "/b/camera_info": INFO, "/radar": CLOUD}
    with pytest.raises(BagError, match="name the one to use"):
        find_topics(bag(types))
    assert find_topics(bag(types), camera_info="/b/camera_info").camera_info == "/b/camera_info"


def test_clouds_are_told_apart_by_name():
    clouds = {"/ars548/points": CLOUD, "/points_raw": CLOUD, "/srr520/detections": CLOUD, "/map": CLOUD}
    topics = find_topics(bag({**clouds, "/cam/image": IMAGE, "/cam/camera_info": INFO}))
    assert (topics.radars, topics.lidar) == (("/ars548/points", "/srr520/detections"), "/points_raw")


@pytest.mark.parametrize(("lacking", "role"), [(0, "camera image"), (1, "camera_info"), (2, "radar")])
@pytest.mark.parametrize("how", ["absent", "without a message"])
def test_what_is_lacking_is_named_with_what_there_is(lacking, role, how):
    missing = list(MINIMAL)[lacking]
    types = {name: kind for name, kind in MINIMAL.items() if name != missing} if how == "absent" else MINIMAL
    with pytest.raises(BagError, match=f"the bag has no {role}") as caught:
        find_topics(bag(types, empty=(missing,)))
    assert all(name in str(caught.value) for name in MINIMAL if name != missing)


def test_an_empty_bag_lacks_everything():
    with pytest.raises(BagError, match="it holds no messages"):
        find_topics([])


@pytest.mark.parametrize(
    ("radars", "found"),
    [
        ({"/front/scan": SCAN}, ("/front/scan",)),
        ({"/radar_front/scan": SCAN, "/radar_front/points": CLOUD}, ("/radar_front/scan",)),
        ({"/radar_front/scan": SCAN, "/radar_rear/points": CLOUD}, ("/radar_front/scan", "/radar_rear/points")),
        ({"/radar_scan": SCAN, "/radar_points": CLOUD}, ("/radar_points", "/radar_scan")),
    ],
)
def test_scans_are_radars_and_win_over_a_cloud_in_their_namespace(radars, found):
    assert find_topics(bag({"/cam/image": IMAGE, "/cam/camera_info": INFO, **radars})).radars == found


def test_names_given_are_taken_and_checked():
    types = bag({**SIMULATED, "/scan/returns": CLOUD})
    topics = find_topics(types, radars=["/scan/returns"], lidar="/scan/returns", depth="/ground_truth/depth")
    assert (topics.radars, topics.lidar) == (("/scan/returns",), "/scan/returns")
    assert find_topics(types, radars=[]).radars == ()
    with pytest.raises(BagError, match=r"no radar topic /radar of .*2 or .*RadarScan; it has .*/radar/points"):
        find_topics(types, radars=["/radar"])
    with pytest.raises(BagError, match=r"no image topic /radar/points of .*Image or .*CompressedImage"):
        find_topics(types, image="/radar/points")
