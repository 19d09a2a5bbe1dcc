from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation.materials.surfaces import Label, Surface
from radcam_depth_ros.simulation.objects.animals import AnimalKind, build_animal
from radcam_depth_ros.simulation.objects.bicycles import build_motorcycle
from radcam_depth_ros.simulation.objects.furniture import wire_fence
from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.objects.plants import PlantKind, build_plant
from radcam_depth_ros.simulation.objects.vehicle_parts import VehicleKind
from radcam_depth_ros.simulation.objects.vehicles import build_vehicle, with_lamps_off


def is_sound(mesh: Mesh) -> bool:
    lengths = np.linalg.norm(mesh.normals, axis=-1)
    return bool(np.isfinite(mesh.corners).all() and np.isfinite(mesh.uv).all() and np.allclose(lengths, 1, atol=1e-3))


@pytest.mark.parametrize("kind", list(VehicleKind))
def test_vehicles_stand_on_the_road_and_fit_their_size(kind: VehicleKind) -> None:
    vehicle = build_vehicle(np.random.default_rng(kind.value), kind)
    corners = vehicle.mesh.corners.reshape(-1, 3)
    assert is_sound(vehicle.mesh)
    assert abs(corners[:, 2].min()) < 0.02
    assert np.ptp(corners[:, 0]) == pytest.approx(vehicle.length_m, abs=0.15)
    assert np.ptp(corners[:, 1]) <= 3.0
    assert set(np.unique(vehicle.mesh.label)) <= {Label.CAR, Label.TRUCK, Label.BUS}
    assert Surface.LAMP not in with_lamps_off(vehicle.mesh).surface


@pytest.mark.parametrize("kind", list(PlantKind))
def test_plants_are_sound_and_coarser_far_away(kind: PlantKind) -> None:
    plant = build_plant(np.random.default_rng(1), kind, (0.1, 0.2, 0.05))
    assert is_sound(plant.near)
    assert is_sound(plant.far)
    assert len(plant.far) < len(plant.near)


@pytest.mark.parametrize("kind", list(AnimalKind))
def test_animals_stand_on_the_ground(kind: AnimalKind) -> None:
    corners = build_animal(np.random.default_rng(kind.value), kind).corners
    assert abs(corners[..., 2].min()) < 0.02
    assert 0.4 < corners[..., 2].max() < 2.8


@pytest.mark.parametrize("with_rider", [True, False])
def test_motorcycles_stand_on_the_road(with_rider: bool) -> None:
    vehicle = build_motorcycle(np.random.default_rng(0), with_rider)
    corners = vehicle.mesh.corners.reshape(-1, 3)
    assert abs(corners[:, 2].min()) < 0.02
    assert np.ptp(corners[:, 0]) == pytest.approx(vehicle.length_m, abs=0.3)
    assert (Label.RIDER in vehicle.mesh.label) == with_rider


@settings(max_examples=10, deadline=None)
@given(length=st.floats(0.5, 12), height=st.floats(0.8, 2.5))
def test_a_wire_fence_can_be_seen_through(length: float, height: float) -> None:
    fence = wire_fence(length, height)
    edges = fence.corners[:, 1:] - fence.corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2
    assert area < 0.9 * length * height + 1.0
    assert fence.corners[..., 0].min() > -0.05
    assert fence.corners[..., 0].max() < length + 0.05
