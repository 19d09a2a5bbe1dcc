"""The C++ example, built by CMake with PyTorch's own libtorch: the same depth as the engine's, from files to a file."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from radcam_depth_ros.engine import Engine
from radcam_depth_ros.networks.weights_io import archive, torchscript

EXAMPLE = Path(__file__).parents[1] / "examples" / "cpp"
HEIGHT, WIDTH = 60, 90

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(1800)]  # libtorch's headers take a minute of a free core


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for tool in ("cmake", "c++"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed: the C++ example was not built")
    if not (Path(torch.utils.cmake_prefix_path) / "Torch" / "TorchConfig.cmake").is_file():
        pytest.skip("this build of torch has no files for CMake: the C++ example was not built")
    folder = tmp_path_factory.mktemp("cpp")
    configure = ["cmake", "-S", EXAMPLE, "-B", folder, f"-DCMAKE_PREFIX_PATH={torch.utils.cmake_prefix_path}"]
    for command in ([*configure, "-DCMAKE_BUILD_TYPE=Release"], ["cmake", "--build", folder]):
        subprocess.run(command, check=True)
    return folder / "depth"


def read_pfm(path: Path) -> np.ndarray:
    magic, size, scale, pixels = path.read_bytes().split(b"\n", 3)
    assert (magic, scale) == (b"Pf", b"-1.0")
    width, height = map(int, size.split())
    return np.frombuffer(pixels, "<f4").reshape(height, width)[::-1]


def test_its_depth_is_the_engines(program: Path, small_weights: Path, tmp_path: Path) -> None:
    loaded = archive.load(small_weights)
    torchscript.export(loaded, tmp_path / "network.pt")
    image = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "image.ppm"), image[:, :, ::-1])
    (tmp_path / "returns.csv").write_text(
        "# u,v,depth,rcs,speed,age\n40.5,30,20,5,,0\n70,31,35.5,,,\n", encoding="ascii"
    )
    files = [tmp_path / name for name in ("network.pt", "image.ppm", "returns.csv", "depth.pfm")]
    subprocess.run([program, *files, "630", "1.5"], check=True)
    padded = np.zeros((64, 96, 3), np.uint8)
    padded[:HEIGHT, :WIDTH] = image
    nan, slope = float("nan"), 1.0 / (630.0 * 1.5)
    radar = torch.tensor([[40.5, 30.0, 20.0, 5.0, nan, 0.0], [70.0, 31.0, 35.5, nan, nan, nan]])
    ground = torch.tensor([0.0, slope, -slope * 0.5 * (HEIGHT - 1), 1.0])
    expected = Engine(loaded.network, precision="float32").run(torch.from_numpy(padded), radar, ground).dense
    np.testing.assert_allclose(read_pfm(files[-1]), expected[0, 0, :HEIGHT, :WIDTH].numpy(), atol=1e-3)
    # The road unknown, and no returns.
    files[2].write_bytes(b"")
    subprocess.run([program, *files], check=True)
    unknown = torch.full((4,), nan)
    expected = Engine(loaded.network, precision="float32").run(torch.from_numpy(padded), radar[:0], unknown).dense
    np.testing.assert_allclose(read_pfm(files[-1]), expected[0, 0, :HEIGHT, :WIDTH].numpy(), atol=1e-3)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("image.ppm", b"P5\n1 1\n255\n0", "expected a binary PPM of 8 bits"),
        ("image.ppm", b"P6\n9 9\n255\n0", "expected 243 bytes of pixels"),
        ("returns.csv", b"1,2,3\n", "expected 6 values in the line '1,2,3'"),
    ],
)
def test_wrong_files_are_told(
    name: str, content: bytes, message: str, program: Path, small_weights: Path, tmp_path: Path
) -> None:
    torchscript.export(archive.load(small_weights), tmp_path / "network.pt")
    (tmp_path / "image.ppm").write_bytes(b"P6\n2 1\n255\nabcdef")
    (tmp_path / "returns.csv").write_bytes(b"")
    (tmp_path / name).write_bytes(content)
    files = [tmp_path / file for file in ("network.pt", "image.ppm", "returns.csv", "depth.pfm")]
    done = subprocess.run([program, *files], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert message in done.stderr
    assert not files[-1].exists()
