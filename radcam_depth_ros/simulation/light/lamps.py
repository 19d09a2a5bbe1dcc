"""Point lights: street lamps, head lamps, lamps in tunnels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.light.light import FULL_LUX, Light
from radcam_depth_ros.simulation.materials.surfaces import Label, Surface
from radcam_depth_ros.simulation.objects.scene import Scene

VEHICLES = (Label.CAR, Label.TRUCK, Label.BUS, Label.MOTORCYCLE)
_STREET_REACH_M, _BEAM_REACH_M = 25.0, 60.0
_MOST_LAMPS, _MOST_BEAMS, _MOST_TAILS = 16, 6, 4
_APART_M = 0.8
_HALL_CANDELA = 700.0
# Below the camera and ahead of it, in its axes: where the own head lamps are.
_OWN_LAMP = (0.0, 0.65, 0.5)


@dataclass(frozen=True)
class Lamps:
    """Point lights.

    Attributes:
        place: (L, 3) float32, world.
        aim: (L, 3) float32, unit direction of a head lamp's beam; zeros for a lamp that shines downwards.
        power: (L, 3) float32, (R, G, B) of candela over the full light in lux.
        is_narrow: Whether beams have a bright middle and fall off steeply.
    """

    place: FloatArray
    aim: FloatArray
    power: FloatArray
    is_narrow: bool = False

    def light(self, point: FloatArray, normal: FloatArray) -> FloatArray:
        """Light (N, 3) on surfaces at points (N, 3) with normals (N, 3), relative to full light."""
        total = np.zeros((len(point), 3), np.float32)
        for place, aim, power in zip(self.place, self.aim, self.power, strict=True):
            beam = bool(aim.any())
            reach = np.float32(_BEAM_REACH_M if beam else _STREET_REACH_M)
            near = np.flatnonzero((np.abs(point[:, 0] - place[0]) < reach) & (np.abs(point[:, 1] - place[1]) < reach))
            towards = place - point[near]
            # Nothing is nearer to a lamp than its own glass.
            square = np.maximum(np.einsum("ni,ni->n", towards, towards), np.float32(0.25))
            distance = np.sqrt(square)
            cosine = np.maximum(np.einsum("ni,ni->n", normal[near], towards), 0) / distance
            sine = towards[:, 2] / distance
            shape = _beam(towards, distance, sine, aim, self.is_narrow) if beam else np.clip(sine + 0.15, 0.03, 1)
            fade = np.square(np.maximum(1 - square / reach**2, 0))
            total[near] += (shape * cosine * fade / square)[:, None] * power
        return total


def _beam(towards: FloatArray, distance: FloatArray, down: FloatArray, aim: FloatArray, is_narrow: bool) -> FloatArray:
    """Shape of a dipped beam: wide, bright below the horizon, nearly dark above."""
    ahead = -(towards @ aim) / distance
    aside = np.maximum(1 - ahead, 0)
    wide = np.exp(-np.square(aside / np.float32(0.09)))
    if is_narrow:
        # Half of the light within some 9 degrees, a little to all sides.
        wide = np.float32(0.15) * wide + np.exp(-aside / np.float32(0.012))
    below = np.exp(-np.maximum(down, 0) / np.float32(0.10))
    cut = np.clip(0.5 + down / np.float32(0.02), 0.04, 1)
    return np.asarray(np.where(ahead > 0, wide * below * cut, 0), np.float32)


def shining_lamps(scene: Scene, light: Light, world_from_camera: RigidTransform, beams: bool = False) -> Lamps:
    """The lamps nearest to a camera that make a difference under this light.

    Args:
        scene: What is lit.
        light: Of the seed.
        world_from_camera: The camera's pose.
        beams: Whether head lamps have a bright middle, and tail lamps give light.
    """
    eye = world_from_camera.translation.astype(np.float32)
    faces, count = scene.faces, scene.count
    shining = np.flatnonzero(faces.surface[:count] == Surface.LAMP)
    label = faces.label[shining]
    vehicle = np.isin(label, VEHICLES)
    hall = np.flatnonzero(~vehicle & (label != Label.POLE) & (label != Label.TRAFFIC_LIGHT))
    found = [_all_round(scene, shining[hall], np.full(3, _HALL_CANDELA), eye)]
    if max(light.street_lamps) > 0:
        found.append(_all_round(scene, shining[label == Label.POLE], np.array(light.street_lamps), eye))
    if light.beam_candela > 0:
        found += [_own(light, world_from_camera, beams), _beams(scene, shining[vehicle], light, eye)]
        if beams:
            glass = scene.faces.colour[shining]
            red = vehicle & (glass[:, 0] > 4 * glass[:, 1]) & (np.abs(scene.velocity[shining]).sum(axis=1) > 0.5)
            candela = (12.0 + 40.0 * light.braking) * np.array([1.0, 0.06, 0.03])
            found.append(_all_round(scene, shining[red], candela, eye, _MOST_TAILS))
    parts = zip(*((lamps.place, lamps.aim, lamps.power) for lamps in found), strict=True)
    place, aim, power = (np.concatenate(part).astype(np.float32) for part in parts)
    return Lamps(place, aim, power, beams)


def _own(light: Light, world_from_camera: RigidTransform, two: bool) -> Lamps:
    """The own head lamps: one in the middle, or two that are seen to be two."""
    forward = world_from_camera.rotation[:, 2]
    aside = (-0.7, 0.7) if two else (0.0,)
    place = world_from_camera.apply(np.array([(x, *_OWN_LAMP[1:]) for x in aside])).astype(np.float32)
    power = np.full((len(aside), 3), (2 + two) / len(aside) * light.beam_candela / FULL_LUX, np.float32)
    return Lamps(place, np.tile(forward.astype(np.float32), (len(aside), 1)), power)


def _all_round(
    scene: Scene,
    faces: npt.NDArray[np.integer],
    candela: npt.NDArray[np.floating],
    eye: FloatArray,
    most: int = _MOST_LAMPS,
) -> Lamps:
    place, _ = _clusters(scene, faces, eye, most)
    return Lamps(place, np.zeros_like(place), np.tile(candela / FULL_LUX, (len(place), 1)).astype(np.float32))


def _beams(scene: Scene, faces: npt.NDArray[np.integer], light: Light, eye: FloatArray) -> Lamps:
    """Head lamps of vehicles that drive: they point where they go."""
    colour, velocity = scene.faces.colour[faces], scene.velocity[faces]
    white = (colour[:, 2] > 0.5 * colour[:, 0]) & (np.linalg.norm(velocity, axis=1) > 0.5)
    place, first = _clusters(scene, faces[white], eye, _MOST_BEAMS)
    aim = scene.velocity[first]
    aim = aim / np.maximum(np.linalg.norm(aim, axis=1, keepdims=True), 1e-6)
    power = np.full((len(place), 3), light.beam_candela / FULL_LUX, np.float32)
    return Lamps(place + aim * np.float32(0.3), aim, power)


def _clusters(
    scene: Scene, faces: npt.NDArray[np.integer], eye: FloatArray, most: int
) -> tuple[FloatArray, npt.NDArray[np.integer]]:
    """Middles (L, 3) and first faces (L,) of lamps: faces that follow one another and lie together are one lamp."""
    if len(faces) == 0:
        return np.zeros((0, 3), np.float32), faces
    middle = scene.faces.corners[faces].mean(axis=1)
    starts = np.flatnonzero(np.r_[True, np.linalg.norm(np.diff(middle, axis=0), axis=1) > _APART_M])
    sizes = np.diff(np.r_[starts, len(faces)])
    place = np.add.reduceat(middle, starts, axis=0) / sizes[:, None]
    nearest = np.argsort(np.linalg.norm(place - eye, axis=1))[:most]
    return np.asarray(place[nearest], np.float32), faces[starts[nearest]]
