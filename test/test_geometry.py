from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from radcam_depth_ros.frame import ASSUMED_HEIGHT_M, CameraModel, FrameError, GroundPlane
from radcam_depth_ros.geometry import (
    MAX_LINKS,
    CanonicalCamera,
    GeometryError,
    RigidTransform,
    TransformTree,
    depth_image,
    ground_coefficients,
    ground_plane,
    project,
    unproject,
)

finite = st.floats(-50, 50, allow_nan=False)
cameras = st.builds(
    CameraModel,
    width=st.integers(32, 2048),
    height=st.integers(32, 1080),
    fx=st.floats(200, 2500),
    fy=st.floats(200, 2500),
    cx=st.floats(0, 2048),
    cy=st.floats(0, 1080),
)


@st.composite
def transforms(draw: st.DrawFn) -> RigidTransform:
    quaternion = draw(npst.arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 0.1))
    return RigidTransform.from_quaternion(draw(npst.arrays(np.float64, 3, elements=finite)), quaternion)


def same(a: RigidTransform, b: RigidTransform) -> bool:
    return np.allclose(a.rotation, b.rotation, atol=1e-9) and np.allclose(a.translation, b.translation, atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(transforms(), transforms(), transforms())
def test_transforms_form_a_group(a: RigidTransform, b: RigidTransform, c: RigidTransform) -> None:
    assert same(a @ a.inverse(), RigidTransform.identity())
    assert same((a @ b) @ c, a @ (b @ c))
    point = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-3)


@settings(max_examples=50, deadline=None)
@given(transforms())
def test_quaternion_goes_there_and_back(transform: RigidTransform) -> None:
    back = RigidTransform.from_quaternion(transform.translation, transform.quaternion)
    assert same(back, transform)
    assert transform.quaternion[3] >= 0


def test_half_turns_have_a_quaternion() -> None:
    for axis in np.eye(3):
        turn = RigidTransform.from_quaternion([0, 0, 0], [*axis, 0])
        np.testing.assert_allclose(np.abs(turn.quaternion[:3]), axis, atol=1e-9)


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, 1]])
def test_bad_quaternions_are_refused(quaternion: list[float]) -> None:
    with pytest.raises(GeometryError, match="quaternion"):
        RigidTransform.from_quaternion([0, 0, 0], quaternion)


@settings(max_examples=50, deadline=None)
@given(cameras, npst.arrays(np.float32, (20, 3), elements=st.floats(-20, 20, width=32)))
def test_projection_goes_there_and_back(camera: CameraModel, points: np.ndarray) -> None:
    points[:, 2] = np.abs(points[:, 2]) + 1
    uv, depth = project(points, camera)
    ray = (np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(camera.matrix).T) * depth[:, None]
    np.testing.assert_allclose(ray, points, atol=2e-3)


def test_points_behind_the_camera_have_no_pixel() -> None:
    uv, depth = project(np.array([[0.0, 0.0, -5.0], [0.0, 0.0, 0.0]]), CameraModel(64, 48, 50, 50, 32, 24))
    assert np.isnan(uv).all()
    assert (depth <= 0).all()


def test_a_depth_image_gives_its_points_back_and_the_nearest_wins() -> None:
    camera = CameraModel(64, 48, 50, 50, 31.5, 23.5)
    depth = np.random.default_rng(0).uniform(2, 60, (48, 64)).astype(np.float32)
    points = unproject(depth, camera).reshape(-1, 3)
    np.testing.assert_allclose(depth_image(np.vstack([points * 1.5, points]), camera), depth, rtol=1e-5)


def test_pixels_and_their_points_are_one() -> None:
    camera = CameraModel(6, 4, 5.0, 7.0, 2.5, 1.5)
    depth_m = np.linspace(1, 30, 24, dtype=np.float32).reshape(4, 6)
    uv, z = project(unproject(depth_m, camera).reshape(-1, 3), camera)
    assert np.allclose(z, depth_m.ravel())
    assert np.allclose(uv, [[column, row] for row in range(4) for column in range(6)], atol=1e-4)


def test_an_empty_cloud_is_an_empty_depth_image() -> None:
    assert np.isnan(depth_image(np.zeros((0, 3)), CameraModel(8, 6, 5, 5, 4, 3))).all()


@settings(max_examples=50, deadline=None)
@given(transforms(), transforms(), transforms(), st.permutations(range(3)))
def test_chains_and_inverses_do_not_depend_on_the_order(
    a: RigidTransform, b: RigidTransform, c: RigidTransform, order: list[int]
) -> None:
    links = [("base", "camera", a), ("/base", "mast", b), ("mast", "/radar", c)]
    tree = TransformTree()
    for index in order:
        tree.set(*links[index])
    assert same(tree.lookup("base", "radar"), b @ c)
    assert same(tree.lookup("camera", "radar"), a.inverse() @ b @ c)
    assert same(tree.lookup("radar", "camera"), (a.inverse() @ b @ c).inverse())
    assert same(tree.lookup("radar", "radar"), RigidTransform.identity())


def test_missing_links_are_named() -> None:
    tree = TransformTree()
    with pytest.raises(GeometryError, match="nothing came on"):
        tree.lookup("camera", "radar")
    tree.set("base", "camera", RigidTransform.identity())
    with pytest.raises(GeometryError, match=r"'camara' is not known .did you mean 'camera'"):
        tree.lookup("camara", "base")
    tree.set("mast", "radar", RigidTransform.identity())
    with pytest.raises(GeometryError, match="two trees, below 'mast' and 'base'"):
        tree.lookup("camera", "radar")
    assert not tree.can_transform("camera", "radar")
    tree.set("base", "mast", RigidTransform.identity())
    assert tree.can_transform("camera", "radar")


@pytest.mark.parametrize(("parent", "child"), [("c", "a"), ("a", "a"), ("b", "a")])
def test_cycles_are_refused_and_leave_the_tree_as_it_was(parent: str, child: str) -> None:
    tree = TransformTree()
    tree.set("a", "b", RigidTransform.identity())
    tree.set("b", "c", RigidTransform.identity())
    with pytest.raises(GeometryError, match="cycle"):
        tree.set(parent, child, RigidTransform.identity())
    assert same(tree.lookup("a", "c"), RigidTransform.identity())


def test_a_frame_can_be_set_again_and_moved_to_another_parent() -> None:
    tree = TransformTree()
    tree.set("a", "b", RigidTransform.identity())
    tree.set("a", "b", RigidTransform(np.eye(3), np.array([1.0, 0, 0])))
    assert tree.lookup("a", "b").translation[0] == 1.0
    tree.set("z", "b", RigidTransform.identity())
    assert not tree.can_transform("a", "b")


@settings(max_examples=50, deadline=None)
@given(cameras, st.floats(0.5, 3), st.floats(-0.1, 0.1), st.floats(-0.05, 0.05))
def test_the_flat_road_has_the_depth_of_its_points(
    camera: CameraModel, height: float, pitch: float, roll: float
) -> None:
    # A footprint frame on the road (x forward, y left, z up) seen from a camera that is pitched and rolled.
    level = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    tilt = RigidTransform.from_quaternion([0, 0, 0], [np.sin(pitch / 2), 0, np.sin(roll / 2), 1])
    rotation = tilt.rotation @ level
    camera_from_footprint = RigidTransform(rotation, -rotation @ np.array([1.0, 0.2, height]))
    ground = ground_plane(camera_from_footprint)
    assert ground.height_m == pytest.approx(height)
    road = np.array([[8.0, 1, 0], [20, -3, 0], [60, 2, 0]])
    uv, depth = project(camera_from_footprint.apply(road), camera)
    seen = depth > 0.5
    inverse = np.column_stack([uv, np.ones(3)]) @ ground_coefficients(ground, camera)[:3]
    np.testing.assert_allclose((1 / depth)[seen], inverse[seen], rtol=2e-2, atol=1e-4)


def test_an_unknown_road_is_nan() -> None:
    camera = CameraModel(8, 6, 5, 5, 4, 3)
    assert np.isnan(ground_coefficients(GroundPlane(), camera)[:3]).all()
    assert ground_coefficients(GroundPlane(), camera)[3] == 0


def test_an_unknown_road_is_assumed_to_be_level() -> None:
    known = GroundPlane(2.0, (0.0, -1.0, 0.0))
    assert known.or_assumed() is known
    assumed = GroundPlane().or_assumed()
    assert (assumed.height_m, assumed.up, assumed.is_assumed) == (ASSUMED_HEIGHT_M, (0.0, -1.0, 0.0), True)
    camera = CameraModel(8, 6, 5, 5, 4, 3)
    assert (ground_coefficients(known, camera)[3], ground_coefficients(assumed, camera)[3]) == (1, 0)


@settings(max_examples=50, deadline=None)
@given(cameras, st.floats(300, 800))
def test_the_canonical_camera_keeps_rays(camera: CameraModel, focal: float) -> None:
    if camera.width * camera.height * focal**2 > 3.9e6 * camera.fx * camera.fy:
        return  # refused, see below
    plan = CanonicalCamera.plan(camera, focal)
    assert plan.network.width % 32 == 0
    assert plan.network.height % 32 == 0
    assert plan.network.fx == pytest.approx(focal, abs=focal / plan.scaled.width)
    # The image's corners, as edges of pixels, stay the same rays.
    for u, scaled_u in ((-0.5, -0.5), (camera.width - 0.5, plan.scaled.width - 0.5)):
        assert (u - camera.cx) / camera.fx == pytest.approx((scaled_u - plan.scaled.cx) / plan.scaled.fx, abs=1e-6)


def test_images_that_would_become_too_large_are_refused() -> None:
    with pytest.raises(GeometryError, match=r"becomes 12600 x 6300 .* crop the image"):
        CanonicalCamera.plan(CameraModel(2000, 1000, 100, 100, 1000, 500), 630)


def test_nonsense_cameras_are_refused() -> None:
    with pytest.raises(FrameError, match="positive focal lengths"):
        CameraModel(64, 48, 0, 0, 0, 0)
    with pytest.raises(FrameError, match="positive image size"):
        CameraModel(0, 48, 1, 1, 0, 0)


def test_a_tree_takes_so_many_frames_and_those_that_are_known_still_move() -> None:
    tree = TransformTree()
    for number in range(MAX_LINKS):
        tree.set("map", f"frame{number}", RigidTransform.identity())
    with pytest.raises(GeometryError, match="1000 frames already, so 'one more' is left out"):
        tree.set("map", "one more", RigidTransform.identity())
    tree.set("frame0", "frame1", RigidTransform.identity())
    assert tree.can_transform("frame1", "frame2")
    assert not tree.can_transform("frame1", "one more")


def test_a_camera_on_the_road_is_refused() -> None:
    for height_m in (-1.0, 0.0, 1e-40):
        with pytest.raises(FrameError, match=r"must be positive, 0\.001 m or more"):
            GroundPlane(height_m)
