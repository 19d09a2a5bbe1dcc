"""Objects beside a road: lamps, signs, traffic lights, bollards, fences, walls, guard rails, shelters, pylons."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Colour, Label, Material, Surface, Texture, scaled
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, join, quads, tube
from radcam_depth_ros.simulation.settings.randomness import pick


def _steel(tone: float) -> Material:
    return Material(Surface.METAL, Label.POLE, (tone, tone, tone * 1.02))


def lamp(rng: np.random.Generator) -> Mesh:
    """A street lamp whose arm reaches to -y."""
    steel = _steel(rng.uniform(0.08, 0.4))
    # The label tells a street lamp's glass from a vehicle's: it shines at night.
    glass = Material(Surface.LAMP, Label.POLE, (0.7, 0.7, 0.68))
    height, arm = rng.uniform(5, 10), rng.uniform(0.3, 2.2)
    return join(
        [
            tube(0.1, height, steel, 8, 0.06),
            box([0.09, arm, 0.09], [0, -arm / 2, height], steel),
            box([0.22, 0.6, 0.12], [0, -arm, height], steel),
            box([0.18, 0.5, 0.06], [0, -arm, height - 0.08], glass),
        ]
    )


def pole(rng: np.random.Generator) -> Mesh:
    """A wooden or concrete mast."""
    tone = rng.uniform(0.08, 0.35)
    wood = Material(Surface.WOOD, Label.POLE, (tone * 1.1, tone, tone * 0.85), Texture.BARK, 1.0)
    return tube(0.14, rng.uniform(6.5, 10), wood, 8, 0.1)


def tube_pole(radius: float, height: float, colour: Colour) -> Mesh:
    """A mast with a crossbar along y."""
    wood = Material(Surface.WOOD, Label.POLE, colour, Texture.BARK, 1.0)
    return join([tube(radius, height, wood, 8, radius * 0.75), box([0.1, 1.4, 0.12], [0, 0, height - 0.6], wood)])


def traffic_sign(rng: np.random.Generator) -> Mesh:
    """One or two plates on a post, facing -x."""
    steel = _steel(0.35)
    height = rng.uniform(2.0, 2.9)
    plates = [_plate(rng, height - 0.75 * index) for index in range(1 + int(rng.random() < 0.25))]
    return join([tube(0.035, height + 0.35, steel, 6), *plates])


def _plate(rng: np.random.Generator, height: float) -> Mesh:
    """A round, three-cornered, square or long plate with a rim of another colour."""
    corners, turn = pick(rng, [(24, 0.0), (3, np.pi / 2), (3, -np.pi / 2), (4, np.pi / 4), (4, 0.0)])
    rims = ((0.55, 0.02, 0.02), (0.02, 0.08, 0.45), (0.8, 0.8, 0.8), (0.75, 0.5, 0.02))
    fills = ((0.85, 0.85, 0.85), (0.02, 0.1, 0.5), (0.75, 0.5, 0.02))
    rim, fill = pick(rng, rims), pick(rng, fills)
    radius = rng.uniform(0.3, 0.42)
    angle = np.arange(corners) / corners * 2 * np.pi + turn
    back = Material(Surface.METAL, Label.TRAFFIC_SIGN, (0.3, 0.3, 0.3))
    layers = []
    for scale, x, material in (
        (1.0, -0.045, Material(Surface.SIGN_FACE, Label.TRAFFIC_SIGN, rim)),
        (0.72, -0.05, Material(Surface.SIGN_FACE, Label.TRAFFIC_SIGN, fill, Texture.SIGN)),
        (1.0, -0.04, back),
    ):
        reach = radius * scale
        ring = np.column_stack([np.full(corners, x), reach * np.cos(angle), height + reach * np.sin(angle)])
        centre, after = np.broadcast_to([x, 0.0, height], ring.shape), np.roll(ring, -1, axis=0)
        layers.append(quads(np.stack([centre, ring, after, after], 1), material))
    return join(layers)


def board(rng: np.random.Generator) -> Mesh:
    """A direction board or an advertisement on two posts, facing -x."""
    width, height, low = rng.uniform(1.2, 4.0), rng.uniform(0.9, 2.4), rng.uniform(0.8, 2.8)
    colours = ((0.75, 0.55, 0.02), (0.02, 0.1, 0.45), (0.8, 0.8, 0.8), (0.1, 0.3, 0.12))
    face = Material(Surface.SIGN_FACE, Label.TRAFFIC_SIGN, pick(rng, colours), Texture.SIGN, max(width, height))
    posts = [tube(0.06, low + height, _steel(0.3), 6).moved((0.08, side * width * 0.4, 0)) for side in (-1, 1)]
    return join([*posts, box([0.05, width, height], [0, 0, low + height / 2], face)])


def gantry(rng: np.random.Generator, span: float) -> Mesh:
    """A sign bridge over the road, from y = 0 to y = -span."""
    steel = _steel(0.4)
    face = Material(Surface.SIGN_FACE, Label.TRAFFIC_SIGN, (0.02, 0.08, 0.4), Texture.SIGN, 3.0)
    parts = [
        tube(0.18, 7.0, steel, 8),
        tube(0.18, 7.0, steel, 8).moved((0, -span, 0)),
        box([0.3, span, 0.4], [0, -span / 2, 6.6], steel),
    ]
    for _ in range(int(rng.integers(1, 4))):
        width = rng.uniform(2.5, 4.5)
        parts.append(box([0.06, width, 2.4], [-0.25, -rng.uniform(width / 2, span - width / 2), 6.6], face))
    return join(parts)


def traffic_light(rng: np.random.Generator, reach: float) -> Mesh:
    """A signal on a post, and where `reach` > 0 another on an arm over the lane at -y."""
    steel = _steel(0.2)
    black = Material(Surface.METAL, Label.TRAFFIC_LIGHT, (0.02, 0.02, 0.02))
    lit = int(rng.integers(3))
    colours = ((0.9, 0.05, 0.03), (0.9, 0.5, 0.05), (0.05, 0.9, 0.35))
    places = [(0.0, 2.6)] if reach <= 0 else [(0.0, 2.6), (-reach, 5.6)]
    parts = [tube(0.07, 3.2 if reach <= 0 else 6.0, steel, 8)]
    if reach > 0:
        parts.append(box([0.1, reach, 0.1], [0, -reach / 2, 5.95], steel))
    for y, z in places:
        parts.append(box([0.25, 0.32, 0.95], [-0.1, y, z], black))
        for index, colour in enumerate(colours):
            glass = Material(Surface.LAMP, Label.TRAFFIC_LIGHT, scaled(colour, 1.0 if index == lit else 0.08))
            parts.append(box([0.04, 0.2, 0.2], [-0.235, y, z + 0.28 * (1 - index)], glass))
    return join(parts)


def bollard(rng: np.random.Generator) -> Mesh:
    """A delineator or bollard."""
    white = Material(Surface.METAL, Label.POLE, (0.75, 0.75, 0.73))
    dark = Material(Surface.METAL, Label.POLE, (0.03, 0.03, 0.03))
    height = rng.uniform(0.8, 1.05)
    return join([tube(0.06, height, white, 6), tube(0.063, 0.14, dark, 6).moved((0, 0, height - 0.25))])


def litter_bin(rng: np.random.Generator) -> Mesh:
    """A wheeled bin or a grey cabinet."""
    tone = rng.uniform(0.02, 0.3)
    colour = (tone * rng.uniform(0.5, 1.2), tone, tone * rng.uniform(0.4, 1.2))
    look = Material(Surface.CANVAS, Label.IGNORE, colour)
    size = rng.uniform([0.4, 0.4, 0.9], [0.9, 0.7, 1.4])
    return box(size.tolist(), [0, 0, float(size[2]) / 2], look)


def shelter(rng: np.random.Generator) -> Mesh:
    """A bus stop open towards -y."""
    steel = Material(Surface.METAL, Label.BUILDING, (0.15, 0.15, 0.16))
    glass = Material(Surface.GLASS, Label.BUILDING, (0.10, 0.12, 0.12))
    poster = Material(Surface.SIGN_FACE, Label.BUILDING, tuple(rng.uniform(0.1, 0.8, 3)), Texture.POSTER, 1.9)
    return join(
        [
            box([4.2, 1.6, 0.12], [0, 0.7, 2.5], steel),
            box([4.0, 0.04, 1.9], [0, 1.4, 1.35], glass),
            box([0.05, 1.3, 1.9], [-2.0, 0.7, 1.3], poster),
            *(box([0.08, 0.08, 2.5], [x, y, 1.25], steel) for x in (-2, 2) for y in (0.1, 1.4)),
        ]
    )


def picket_fence(rng: np.random.Generator, length: float, height: float) -> Mesh:
    """A fence along x with gaps between its pickets."""
    tones = ((0.3, 0.2, 0.12), (0.75, 0.75, 0.73), (0.12, 0.14, 0.12), (0.35, 0.35, 0.36))
    wood = Material(Surface.WOOD, Label.FENCE, pick(rng, tones), Texture.PLAIN)
    pitch = rng.uniform(0.16, 0.32)
    x = np.arange(0, length, pitch)[:, None]
    width = pitch * rng.uniform(0.3, 0.65)
    foot = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 0, 0]]) * width
    pickets = x[..., None] * [1, 0, 0] + foot + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1], [0, 0, 1]]) * height
    rails = [box([length, 0.05, 0.08], [length / 2, 0.03, height * share], wood) for share in (0.25, 0.8)]
    return join([quads(pickets, wood), *rails])


def panel_fence(rng: np.random.Generator, length: float, height: float) -> Mesh:
    """A closed wooden fence along x."""
    tone = rng.uniform(0.08, 0.4)
    planks = Material(Surface.WOOD, Label.FENCE, (tone * 1.15, tone, tone * 0.75), Texture.PLANKS, 2.2)
    return box([length, 0.06, height], [length / 2, 0, height / 2], planks)


def garden_wall(rng: np.random.Generator, length: float, height: float) -> Mesh:
    """A low wall along x."""
    tone = rng.uniform(0.2, 0.7)
    texture = pick(rng, (Texture.COBBLES, Texture.PAVING, Texture.BRICK, Texture.CONCRETE))
    stone = Material(Surface.PAVING, Label.WALL, (tone, tone * 0.95, tone * 0.88), texture, 2.0)
    return box([length, 0.3, height], [length / 2, 0, height / 2], stone)


def wire_fence(length: float, height: float) -> Mesh:
    """A fence of wire mesh between posts, along x: what is behind shows through."""
    wire = Material(Surface.METAL, Label.FENCE, (0.25, 0.27, 0.25))
    post = tube(0.03, height, wire, 5)
    rise, thick = 0.25, 0.006
    starts = np.arange(-height, length, rise)
    faces = []
    for lean in (1.0, -1.0):
        # Wires at 45 degrees, cut off at both ends of the fence.
        low, high = np.clip(starts, 0, length), np.clip(starts + height, 0, length)
        z0, z1 = low - starts, high - starts
        if lean < 0:
            z0, z1 = height - z0, height - z1
        zero = np.zeros_like(low)
        first, last = np.stack([low, zero, z0], -1), np.stack([high, zero, z1], -1)
        wide = np.array([0.0, 0.0, 2 * thick])
        faces.append(np.stack([first, last, last + wide, first + wide], 1)[high - low > 0.02])
    posts = [post.moved((float(x), 0.0, 0.0)) for x in np.arange(0.0, length, 2.5)]
    rails = [box([length, 0.02, 0.02], [length / 2, 0, z], wire) for z in (0.08, height)]
    return join([quads(np.concatenate(faces), wire), *posts, *rails])


def guard_rail(length: float) -> Mesh:
    """A steel rail on posts along x, its face towards -y."""
    steel = Material(Surface.METAL, Label.FENCE, (0.42, 0.43, 0.44), Texture.METAL, 2.0)
    profile = [(0.0, 0.45), (-0.08, 0.52), (0.0, 0.60), (-0.08, 0.68), (0.0, 0.75)]
    faces = [
        [(0, y, z), (length, y, z), (length, next_y, next_z), (0, next_y, next_z)]
        for (y, z), (next_y, next_z) in pairwise(profile)
    ]
    post = box([0.1, 0.06, 0.7], [0.0, 0.08, 0.35], steel)
    posts = [post.moved((float(x), 0.0, 0.0)) for x in np.arange(0.5, length, 4.0)]
    return join([quads(faces, steel), *posts])


def concrete_barrier(length: float) -> Mesh:
    """A concrete wall in the middle of a motorway, along x."""
    concrete = Material(Surface.PAVING, Label.WALL, (0.4, 0.39, 0.37), Texture.PAVING, 4.0)
    return box([length, 0.6, 0.9], [length / 2, 0, 0.45], concrete, (1.0, 0.4))


def noise_wall_look(rng: np.random.Generator) -> Material:
    """What a noise barrier is made of."""
    tone, green = rng.uniform(0.06, 0.5), rng.uniform(0.9, 1.3)
    texture = pick(rng, (Texture.PLANKS, Texture.CONCRETE, Texture.HEDGE))
    return Material(Surface.PAVING, Label.WALL, (tone, tone * green, tone * 0.85), texture, 4.0)


def noise_wall(length: float, height: float, face: Material) -> Mesh:
    """A noise barrier along x."""
    return box([length, 0.25, height], [length / 2, 0, height / 2], face)


def pylon() -> Mesh:
    """A lattice mast of a power line, across x."""
    steel = _steel(0.3)
    faces = []
    for z in np.arange(0, 26, 4.0):
        wide, narrow = 2.6 * (1 - z / 32), 2.6 * (1 - (z + 4) / 32)
        for sx in (-1, 1):
            for sy in (-1, 1):
                (x, y), (far_x, far_y), top = (sx * wide, sy * wide), (sx * narrow, sy * narrow), z + 4
                faces.append([(x - 0.1, y, z), (x + 0.1, y, z), (far_x + 0.1, far_y, top), (far_x - 0.1, far_y, top)])
                faces.append([(x, y, z), (x, y + 0.14, z), (far_x, -far_y + 0.14, top), (far_x, -far_y, top)])
    parts = [quads(faces, steel)]
    parts += [box([0.3, 12.0 - 2 * k, 0.3], [0, 0, 18 + 4 * k], steel) for k in range(3)]
    return join(parts)
