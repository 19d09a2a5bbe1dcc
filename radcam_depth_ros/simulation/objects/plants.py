"""Trees, bushes and hedges: clouds of small faces around spheres, so that light and laser pass through the gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.materials.surfaces import Colour, Label, Material, Surface, Texture, scaled
from radcam_depth_ros.simulation.objects.mesh import Mesh, ball, box, cross, join, quads, tube


class PlantKind(IntEnum):
    """Kinds of plant along a street."""

    BROADLEAF = 0
    BARE = 1
    CONIFER = 2
    BUSH = 3
    BARE_BUSH = 4


@dataclass(frozen=True)
class Plant:
    """One prototype in two finenesses, standing on the origin.

    Attributes:
        near: For beside the road.
        far: For where it covers few pixels.
    """

    near: Mesh
    far: Mesh


def build_plant(rng: np.random.Generator, kind: PlantKind, colour: Colour) -> Plant:
    """A plant of a kind.

    Args:
        rng: Random generator.
        kind: What to grow.
        colour: Linear RGB of its leaves, or of its twigs where it has none.
    """
    if kind is PlantKind.BROADLEAF:
        return _broadleaf(rng, colour)
    if kind is PlantKind.CONIFER:
        return _conifer(rng, colour)
    if kind is PlantKind.BARE:
        return _bare(rng, colour)
    return _bush(rng, colour, bare=kind is PlantKind.BARE_BUSH)


def hedge(rng: np.random.Generator, length: float, width: float, height: float, colour: Colour) -> Mesh:
    """A clipped hedge along x, from the origin on: a dark core in a coat of leaves."""
    core = Material(Surface.FOLIAGE, Label.VEGETATION, scaled(colour, 0.6), Texture.HEDGE, 1.5)
    inner = box([length, width, height], [length / 2, 0, height / 2], core)
    count = int(14 * length)
    side = rng.integers(0, 3, count)
    across = np.where(side == 0, -width / 2, np.where(side == 1, width / 2, rng.uniform(-width / 2, width / 2, count)))
    up = np.where(side == 2, height, rng.uniform(0, height, count))
    centres = np.column_stack([rng.uniform(0, length, count), across, up])
    outward = np.column_stack([np.zeros(count), np.where(side == 2, 0, np.sign(across)), np.where(side == 2, 1.0, 0.2)])
    return join([inner, _leaves(rng, centres, outward, 0.16, _leaf(colour))])


def _leaf(colour: Colour) -> Material:
    return Material(Surface.FOLIAGE, Label.VEGETATION, colour, Texture.LEAF, 1.2)


def _bark(rng: np.random.Generator) -> Material:
    tone = rng.uniform(0.03, 0.14)
    return Material(Surface.WOOD, Label.VEGETATION, (tone * 1.15, tone, tone * 0.85), Texture.BARK, 0.8)


def _leaves(
    rng: np.random.Generator,
    centres: npt.NDArray[np.floating],
    outward: npt.NDArray[np.floating],
    size: float,
    leaf: Material,
) -> Mesh:
    """Faces at random angles whose shading normals point outwards: soft like a crown, rough at its edge."""
    count = len(centres)
    first = rng.standard_normal((count, 3))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = cross(first, rng.standard_normal((count, 3)))
    second /= np.linalg.norm(second, axis=1, keepdims=True) + 1e-9
    half = size * rng.uniform(0.6, 1.3, (count, 1))
    first, second = first * half, second * half * 0.7
    corners = np.stack([centres - first, centres - second, centres + first, centres + second], 1)
    uv = rng.uniform(0, 1, (count, 1, 2)) + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size / leaf.tile_m
    mesh = quads(corners, leaf, uv)
    normal = outward + 0.35 * rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shade = np.repeat(rng.uniform(0.6, 1.3, (count, 1)), 2, axis=0)
    normals = np.repeat(np.repeat(normal, 2, axis=0)[:, None], 3, axis=1).astype(np.float32)
    return replace(mesh, normals=normals, colour=(mesh.colour * shade).astype(np.float32))


def _on_blobs(
    rng: np.random.Generator, blobs: npt.NDArray[np.floating], count: int
) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
    """Points near the skin of spheres (x, y, z, radius) and the directions outwards."""
    chosen = blobs[rng.choice(len(blobs), count, p=blobs[:, 3] ** 2 / (blobs[:, 3] ** 2).sum())]
    outward = rng.standard_normal((count, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    radius = chosen[:, 3:] * rng.uniform(0.75, 1.08, (count, 1))
    return chosen[:, :3] + outward * radius * np.array([1, 1, 0.85]), outward


def _broadleaf(rng: np.random.Generator, colour: Colour) -> Plant:
    height = rng.uniform(4.5, 10.0)
    trunk = height * rng.uniform(0.25, 0.4)
    spread = height * rng.uniform(0.22, 0.34)
    middle = (trunk + height) / 2
    count = int(rng.integers(5, 9))
    x, y = rng.normal(0, spread * 0.45, count), rng.normal(0, spread * 0.45, count)
    z = rng.uniform(trunk + spread * 0.3, height - spread * 0.4, count)
    blobs = np.column_stack([x, y, z, rng.uniform(0.45, 0.8, count) * spread])
    blobs[0] = (0, 0, middle, spread * 0.8)
    stem = tube(0.018 * height + 0.05, middle, _bark(rng), 7, 0.05)
    dark = Material(Surface.FOLIAGE, Label.VEGETATION, scaled(colour, 0.45), Texture.LEAF, 1.2)
    core = [ball(r * 0.72, (x, y, z), dark, sections=8) for x, y, z, r in blobs]
    near = join([stem, *core, _leaves(rng, *_on_blobs(rng, blobs, 750), 0.22, _leaf(colour))])
    far = join([stem, *core[:4], _leaves(rng, *_on_blobs(rng, blobs, 150), 0.42, _leaf(colour))])
    return Plant(near, far)


def _conifer(rng: np.random.Generator, colour: Colour) -> Plant:
    height = rng.uniform(6, 15)
    spread = height * rng.uniform(0.14, 0.22)
    stem = tube(0.012 * height + 0.06, height * 0.95, _bark(rng), 6, 0.03)

    def needles(count: int, size: float) -> Mesh:
        share = 1 - np.sqrt(rng.uniform(0.0, 1.0, count))
        share = np.floor(share * height / 0.55) * 0.55 / height + rng.normal(0, 0.012, count)
        angle = rng.uniform(0, 2 * np.pi, count)
        reach = spread * (1 - share) * rng.uniform(0.45, 1.05, count)
        cos, sin = np.cos(angle), np.sin(angle)
        centres = np.column_stack([reach * cos, reach * sin, height * (0.1 + 0.9 * share) - 0.25 * reach])
        outward = np.column_stack([cos, sin, np.full(count, 0.5)])
        return _leaves(rng, centres, outward, size, _leaf(colour))

    return Plant(join([stem, needles(950, 0.24)]), join([stem, needles(190, 0.5)]))


def _bare(rng: np.random.Generator, colour: Colour) -> Plant:
    height = rng.uniform(5, 12)
    starts, ends, widths = [np.zeros(3)], [np.array([0, 0, height * 0.35])], [0.02 * height]
    order = [0]
    for depth in range(1, 4):
        for parent in [index for index, level in enumerate(order) if level == depth - 1]:
            for _ in range(int(rng.integers(3, 6))):
                along = rng.uniform(0.55, 1.0)
                base = starts[parent] + (ends[parent] - starts[parent]) * along
                direction = (ends[parent] - starts[parent]) / np.linalg.norm(ends[parent] - starts[parent])
                direction = direction + rng.normal(0, 0.55, 3) + np.array([0, 0, 0.25])
                starts.append(base)
                ends.append(
                    base + direction / np.linalg.norm(direction) * height * 0.32 * 0.72**depth * rng.uniform(0.7, 1.3)
                )
                widths.append(widths[parent] * 0.55)
                order.append(depth)
    segments = np.stack([np.array(starts), np.array(ends)], 1)
    thickness = np.maximum(np.array(widths), 0.008)
    bark = _bark(rng)
    twig = replace(bark, colour=colour, texture=Texture.PLAIN)
    level = np.array(order)
    near = [_sticks(segments, thickness, bark), _twigs(rng, segments[level == 3], 0.012, height, twig)]
    inner = level < 3
    far = [_sticks(segments[inner], thickness[inner], bark), _twigs(rng, segments[level == 2], 0.03, height, twig)]
    return Plant(join(near), join(far))


def _sticks(segments: npt.NDArray[np.floating], width: npt.NDArray[np.floating], material: Material) -> Mesh:
    """Two crossed faces for each segment (N, 2, 3)."""
    axis = segments[:, 1] - segments[:, 0]
    first = cross(axis, np.array([[0.31, 0.93, 0.2]]))
    first /= np.linalg.norm(first, axis=1, keepdims=True) + 1e-9
    second = cross(axis, first)
    second /= np.linalg.norm(second, axis=1, keepdims=True) + 1e-9
    faces = []
    for across in (first, second):
        low, high = across * width[:, None], across * width[:, None] * 0.6
        start, stop = segments[:, 0], segments[:, 1]
        faces.append(np.stack([start - low, start + low, stop + high, stop - high], 1))
    return quads(np.concatenate(faces), material)


def _twigs(
    rng: np.random.Generator, branches: npt.NDArray[np.floating], width: float, height: float, twig: Material
) -> Mesh:
    """Five twigs on each branch (N, 2, 3) of a tree of a height."""
    origin = np.repeat(branches, 5, axis=0)
    base = origin[:, 0] + (origin[:, 1] - origin[:, 0]) * rng.uniform(0.3, 1, (len(origin), 1))
    reach = rng.normal(0, 0.05 * height, (len(origin), 3)) + np.array([0, 0, 0.02 * height])
    side = cross(reach, rng.standard_normal(reach.shape))
    side *= width / (np.linalg.norm(side, axis=1, keepdims=True) + 1e-9)
    return quads(np.stack([base - side, base + side, base + reach + side * 0.3, base + reach - side * 0.3], 1), twig)


def _bush(rng: np.random.Generator, colour: Colour, bare: bool) -> Plant:
    height = rng.uniform(0.8, 2.4)
    count = int(rng.integers(2, 6))
    radius = height * rng.uniform(0.3, 0.5, count)
    blobs = np.column_stack([rng.normal(0, height * 0.4, (count, 2)), height - radius * 1.05, radius])
    if bare:

        def stalks(count: int, width: float) -> FloatArray | npt.NDArray[np.floating]:
            base = np.column_stack([rng.normal(0, 0.25 * height, (count, 2)), np.zeros(count)])
            lean = base * rng.uniform(1.2, 2.2, (count, 1))
            tip = lean + np.column_stack([rng.normal(0, 0.15, (count, 2)), height * rng.uniform(0.5, 1, count)])
            side = np.column_stack([rng.normal(0, width, (count, 2)), np.zeros(count)])
            return np.stack([base - side, base + side, tip + side * 0.4, tip - side * 0.4], 1)

        wood = Material(Surface.FOLIAGE, Label.VEGETATION, colour)
        return Plant(quads(stalks(160, 0.012), wood), quads(stalks(40, 0.04), wood))
    dark = Material(Surface.FOLIAGE, Label.VEGETATION, scaled(colour, 0.5), Texture.HEDGE, 1.2)
    core = [ball(r * 0.8, (x, y, z), dark, sections=8) for x, y, z, r in blobs]
    near = join([*core, _leaves(rng, *_on_blobs(rng, blobs, 220), 0.13, _leaf(colour))])
    far = join([*core, _leaves(rng, *_on_blobs(rng, blobs, 40), 0.3, _leaf(colour))])
    return Plant(near, far)
