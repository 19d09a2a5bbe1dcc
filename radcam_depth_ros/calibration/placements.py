"""Candidate poses of a sensor: common mistakes in extrinsics."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import DoubleArray, RigidTransform

OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""From x forward, y left, z up to x right, y down, z forward (REP 103)."""
SMALL_TURNS_DEG = (-8.0, -4.0, -2.0, 2.0, 4.0, 8.0)
_QUARTERS = (90, -90, 180)
_SAME = 1e-3


@dataclass(frozen=True)
class Pose:
    """`camera_from_sensor`; other than a `RigidTransform` it may mirror.

    Attributes:
        matrix: (3, 3) float64, orthonormal.
        translation_m: (3,) float64.
    """

    matrix: DoubleArray
    translation_m: DoubleArray

    @classmethod
    def of(cls, transform: RigidTransform) -> Pose:
        """Of a rigid transform."""
        return cls(transform.rotation, transform.translation)

    @property
    def is_mirrored(self) -> bool:
        """Whether no rotation can do this."""
        return bool(np.linalg.det(self.matrix) < 0)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Position and quaternion, x y z qx qy qz qw, as the node takes them; of a pose that mirrors nothing."""
        values = (*self.translation_m.tolist(), *RigidTransform(self.matrix, self.translation_m).quaternion)
        return tuple(round(value, 4) + 0.0 for value in values)

    def inverse(self) -> Pose:
        """`sensor_from_camera`."""
        return Pose(self.matrix.T, -self.matrix.T @ self.translation_m)

    def apply(self, points_m: npt.NDArray[np.floating]) -> FloatArray:
        """Takes (N, 3) points from the sensor to the camera; (N, 3) float32."""
        return np.asarray(points_m @ self.matrix.T + self.translation_m, np.float32)


@dataclass(frozen=True)
class Placement:
    """A candidate pose of a sensor.

    Attributes:
        name: In few words, as in "the points fit better ...".
        pose: The place.
        why: The mistake, if this pose is right.
        transform: The name of the transform or parameter.
        kind: "given", "coarse" or "small".
    """

    name: str
    pose: Pose
    why: str
    transform: str
    kind: str = "coarse"

    @property
    def advice(self) -> str:
        """The mistake, if this pose is right, and what to do."""
        if self.pose.is_mirrored:
            return self.why
        return f"{self.why}; give {self.transform} {' '.join(map(str, self.pose.numbers))}"


def alternatives(given: Pose, up: npt.NDArray[np.floating], transform: str) -> tuple[Placement, ...]:
    """The given pose, then all others, the simplest mistakes first.

    Args:
        given: As the bag tells it.
        up: (3,) unit vector, the road's normal in the camera's axes.
        transform: The transform's name, such as `camera_from_radar`.
    """
    placements = [Placement("as given", given, "", transform, "given")]

    def add(name: str, pose: Pose, why: str, kind: str = "coarse") -> None:
        # The same place by another name; those that only shift are no other place either.
        if all(np.abs(pose.matrix - other.pose.matrix).max() > _SAME for other in placements):
            placements.append(Placement(name, pose, why, transform, kind))

    def turned(matrix: DoubleArray) -> Pose:
        return Pose(given.matrix @ matrix, given.translation_m)

    optical = OPTICAL_FROM_BODY
    add(
        "turned from x forward to z forward",
        Pose(optical @ given.matrix, optical @ given.translation_m),
        f"{transform} seems to lack the turn from x forward, y left, z up to the camera's x right, y down, z forward",
    )
    add(
        "turned back from z forward to x forward",
        Pose(optical.T @ given.matrix, optical.T @ given.translation_m),
        f"{transform} seems to have the turn from x forward to z forward once too often",
    )
    add("inverted", given.inverse(), f"{transform} seems to be given as its inverse")
    for axis, letter in enumerate("xyz"):
        signs = np.ones(3)
        signs[axis] = -1
        add(
            f"with {letter} flipped",
            turned(np.diag(signs)),
            f"the sensor's {letter} axis seems to point the other way than REP 103 has it (x forward, y left, z up); "
            f"flip the sign of {letter} in the driver or in the cloud",
        )
    for axis, letter in enumerate("xyz"):
        for degrees in _QUARTERS:
            add(
                f"rotated by {degrees} degrees about the sensor's {letter}",
                turned(_about(np.eye(3)[axis], degrees)),
                f"{transform} seems to be off by a turn of {abs(degrees)} degrees about {letter}",
            )
    some_signs = itertools.product((1.0, -1.0), repeat=3)
    for order, chosen in itertools.product(itertools.permutations(range(3)), some_signs):
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = chosen
        if np.linalg.det(matrix) > 0:
            axes = ", ".join("-"[: int(sign < 0)] + "xyz"[place] for place, sign in zip(order, chosen, strict=True))
            add(f"with {axes} for the sensor's x, y, z", turned(matrix), f"{transform} seems to mix up the axes")
    for degrees_small in SMALL_TURNS_DEG:
        direction = "left" if degrees_small > 0 else "right"
        add(
            f"turned by {abs(degrees_small):g} degrees to the {direction}",
            Pose(_about(np.asarray(up), degrees_small) @ given.matrix, given.translation_m),
            f"{transform} seems to be a little off",
            "small",
        )
    return tuple(placements)


def _about(axis: npt.NDArray[np.floating], degrees: float) -> DoubleArray:
    half = math.radians(degrees) / 2
    x, y, z = (math.sin(half) * float(value) for value in axis)
    rotation = RigidTransform.from_quaternion(np.zeros(3), (x, y, z, math.cos(half))).rotation
    rounded = np.round(rotation)
    return rounded if np.allclose(rotation, rounded, atol=1e-9) else rotation
