from __future__ import annotations

import array
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from radcam_depth_ros.messages import Calibration, MessageError
from radcam_depth_ros.resampling import rectify

K = np.array([[150.0, 0.0, 81.0], [0.0, 148.0, 58.0], [0.0, 0.0, 1.0]])
DISTORTIONS = {
    "plumb_bob": [-0.25, 0.08, 0.001, -0.002, 0.01],
    "rational_polynomial": [0.4, -0.1, 0.001, 0.0005, 0.02, 0.75, -0.05, 0.03],
    "equidistant": [-0.02, 0.01, -0.004, 0.001],
}
IMAGE = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (120, 160, 3), np.uint8), (0, 0), 3)


def camera_info(**changes):
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False)
    fields = {
        "width": 160,
        "height": 120,
        "distortion_model": "plumb_bob",
        "d": array.array("d", [0.0] * 5),
        "k": K.reshape(-1),
        "r": np.eye(3).reshape(-1),
        "p": np.hstack([K, np.zeros((3, 1))]).reshape(-1),
        "binning_x": 0,
        "binning_y": 0,
        "roi": roi,
    }
    for name in ("x_offset", "y_offset", "roi_width", "roi_height"):
        if name in changes:
            setattr(roi, name.removeprefix("roi_"), changes.pop(name))
    return SimpleNamespace(**(fields | changes))


def rectified_by(info, image):
    calibration = Calibration(info)
    calibration.check_size(image)
    return rectify(image, calibration.camera, calibration.lens)


def projection(matrix):
    return np.hstack([matrix, np.zeros((3, 1))]).reshape(-1)


def distort(model, rays, distortion):
    rays, distortion = rays.reshape(-1, 1, 3), np.array(distortion)
    if model == "equidistant":
        return cv2.fisheye.projectPoints(rays, np.zeros(3), np.zeros(3), K, distortion)[0].reshape(-1, 2)
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, distortion)[0].reshape(-1, 2)


def camera_values(calibration):
    camera = calibration.camera
    return (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"d": []},
        {"d": [], "distortion_model": ""},
        {"d": [0.0] * 8, "distortion_model": "none"},
        {"p": np.zeros(12)},
        {"r": np.zeros(9)},
        {"binning_x": 1, "binning_y": 1},
    ],
)
def test_an_ideal_camera_passes_images_on(changes):
    calibration = Calibration(camera_info(**changes))
    assert calibration.lens is None
    assert rectify(IMAGE, calibration.camera, calibration.lens) is IMAGE
    assert camera_values(calibration) == (160, 120, 150.0, 148.0, 81.0, 58.0)


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial"])
def test_same_as_undistort(model):
    distortion = DISTORTIONS[model]
    rectified = rectified_by(camera_info(distortion_model=model, d=distortion), IMAGE)
    expected = cv2.undistort(IMAGE, K, np.array(distortion), None, K)
    assert np.abs(rectified.astype(int) - expected).max() <= 2


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(sorted(DISTORTIONS)),
    st.floats(0.7, 1.3),
    st.floats(-10, 10),
    st.tuples(*[st.floats(-0.05, 0.05)] * 3),
    st.floats(-0.35, 0.35),
    st.floats(-0.25, 0.25),
)
def test_a_point_comes_to_lie_where_the_ideal_camera_projects_it(model, scale, shift, rotation, right, down):
    new = K.copy()
    new[:2, :2] *= scale
    new[0, 2] += shift
    r = cv2.Rodrigues(np.array(rotation))[0]
    ray = np.array([right, down, 1.0])
    ideal = new @ r @ ray
    ideal = ideal[:2] / ideal[2]
    seen = distort(model, ray, DISTORTIONS[model])[0]
    for uv in (ideal, seen):
        assume(6 < uv[0] < 153)
        assume(6 < uv[1] < 113)
    # A smooth spot where the lens puts the ray; its centre of mass after rectifying is the ideal pixel.
    rows, columns = np.mgrid[:120, :160]
    spot = 250 * np.exp(-((columns - seen[0]) ** 2 + (rows - seen[1]) ** 2) / 4)
    info = camera_info(distortion_model=model, d=DISTORTIONS[model], r=r.reshape(-1), p=projection(new))
    rectified = rectified_by(info, spot.astype(np.uint8)).astype(float)
    centre = np.array([(columns * rectified).sum(), (rows * rectified).sum()]) / rectified.sum()
    np.testing.assert_allclose(centre, ideal, atol=0.35)


def test_projection_is_the_new_camera():
    new = np.array([[100.0, 0.0, 70.0], [0.0, 99.0, 50.0], [0.0, 0.0, 1.0]])
    calibration = Calibration(camera_info(p=projection(new)))
    assert camera_values(calibration) == (160, 120, 100.0, 99.0, 70.0, 50.0)
    assert calibration.lens is not None


def test_binning_and_region_of_interest():
    info = camera_info(binning_x=2, binning_y=4, x_offset=20, y_offset=8, roi_width=80, roi_height=64)
    assert camera_values(Calibration(info)) == (40, 16, 75.0, 37.0, 30.5, 12.5)
    info = camera_info(binning_x=2, binning_y=2)
    assert camera_values(Calibration(info)) == (80, 60, 75.0, 74.0, 40.5, 29.0)


@pytest.mark.parametrize("model", sorted(DISTORTIONS))
def test_a_region_rectified_is_the_region_of_the_rectified_image(model):
    full = rectified_by(camera_info(distortion_model=model, d=DISTORTIONS[model]), IMAGE)
    info = camera_info(
        distortion_model=model, d=DISTORTIONS[model], x_offset=30, y_offset=20, roi_width=90, roi_height=70
    )
    part = rectified_by(info, np.ascontiguousarray(IMAGE[20:90, 30:120]))
    inner = np.s_[25:-25, 30:-30]  # what the region's image has of the region's rectified image
    assert np.abs(part[inner].astype(int) - full[20:90, 30:120][inner]).max() <= 2


def test_images_that_are_rectified_already():
    info = camera_info(d=DISTORTIONS["plumb_bob"])
    calibration = Calibration(info, image_is_rectified=True)
    assert rectify(IMAGE, calibration.camera, calibration.lens) is IMAGE


def test_model_names_and_trailing_zeros():
    expected = rectified_by(camera_info(d=DISTORTIONS["plumb_bob"]), IMAGE)
    info = camera_info(distortion_model="Plumb_Bob", d=DISTORTIONS["plumb_bob"] + [0.0] * 3)
    np.testing.assert_array_equal(rectified_by(info, IMAGE), expected)
    expected = rectified_by(camera_info(distortion_model="equidistant", d=DISTORTIONS["equidistant"]), IMAGE)
    info = camera_info(distortion_model="fisheye", d=DISTORTIONS["equidistant"] + [0.0])
    np.testing.assert_array_equal(rectified_by(info, IMAGE), expected)


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 161},
        {"d": DISTORTIONS["plumb_bob"]},
        {"k": projection(K)[[0, 1, 2, 4, 5, 6, 8, 9, 10]] * 1.01},
        {"p": np.zeros(12)},
        {"binning_x": 2},
        {"x_offset": 1},
        {"distortion_model": "rational_polynomial"},
    ],
)
def test_matches(changes):
    calibration = Calibration(camera_info())
    assert calibration.matches(camera_info())
    assert not calibration.matches(camera_info(**changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"k": np.zeros(9)}, ["positive focal lengths", "k=[0.0", "calibrate"]),
        ({"k": np.full(9, np.nan)}, ["9 finite numbers", "k"]),
        ({"p": np.full(12, np.inf)}, ["12 finite numbers", "p"]),
        ({"p": -np.hstack([K, np.zeros((3, 1))]).reshape(-1)}, ["positive focal lengths", "camera_info's p"]),
        ({"p": np.array([0.0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0])}, ["positive focal lengths", "camera_info's p"]),
        ({"k": np.array([500.0, 500, 0, 500, 500, 0, 0, 0, 1])}, ["0 below them", "camera_info's k"]),
        ({"k": np.array([500.0, 0, 0, 0, -500, 0, 0, 0, 1])}, ["positive focal lengths"]),
        ({"r": np.array([0.0, 0, 1, 0, 1, 0, -1, 0, 0])}, ["90 degrees or more"]),
        ({"r": np.diag([-1.0, 1, -1]).reshape(-1)}, ["90 degrees or more"]),
        ({"d": [0.1, np.nan]}, ["finite distortion"]),
        ({"d": [0.1] * 5, "distortion_model": "ds"}, ["plumb_bob", "'ds'"]),
        ({"d": [0.1] * 3}, ["4 or 5 distortion coefficients", "got 3"]),
        ({"d": [0.1] * 8}, ["4 or 5 distortion coefficients", "got 8"]),
        ({"r": np.full(9, 0.5)}, ["rotation"]),
        ({"r": np.diag([1.0, 1.0, -1.0]).reshape(-1)}, ["rotation"]),
        ({"width": 0}, ["positive image size", "0 x 120"]),
        ({"x_offset": 100, "roi_width": 80, "roi_height": 10}, ["region of interest", "80 x 10 at 100, 0"]),
    ],
)
def test_bad_calibration_is_refused_with_a_sentence(changes, words):
    with pytest.raises(MessageError) as raised:
        Calibration(camera_info(**changes))
    for word in words:
        assert word in str(raised.value)


def test_an_image_of_another_size_is_refused():
    with pytest.raises(MessageError, match=r"160 x 120 pixels .* got 80 x 60"):
        rectified_by(camera_info(), np.zeros((60, 80, 3), np.uint8))
