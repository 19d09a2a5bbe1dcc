"""Simulates a drive and writes it as a bag."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from radcam_depth_ros import messages
from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.light.shading import Shader
from radcam_depth_ros.simulation.objects.scene import Scene
from radcam_depth_ros.simulation.sensors import rig
from radcam_depth_ros.simulation.sensors.bonnet import Bonnet
from radcam_depth_ros.simulation.sensors.camera import render
from radcam_depth_ros.simulation.sensors.camera_unit import CameraUnit
from radcam_depth_ros.simulation.sensors.lidar import sweep_lidar
from radcam_depth_ros.simulation.sensors.lidar_unit import draw_beams
from radcam_depth_ros.simulation.sensors.optics import motion_field
from radcam_depth_ros.simulation.sensors.radar import sweep_imaging_radar, sweep_radar
from radcam_depth_ros.simulation.sensors.radar_unit import RadarUnit, draw_imaging_radar, draw_radar
from radcam_depth_ros.simulation.sensors.rig import draw_rig
from radcam_depth_ros.simulation.settings.configuration import SimulationConfig
from radcam_depth_ros.simulation.settings.errors import SimulationError
from radcam_depth_ros.simulation.settings.looks import draw_looks
from radcam_depth_ros.simulation.settings.randomness import Stream, generator
from radcam_depth_ros.simulation.timetable import LEAD_S, Event, Sensor, draw_timetable
from radcam_depth_ros.simulation.world.centre_line import DoubleArray
from radcam_depth_ros.simulation.world.ego import EgoMotion
from radcam_depth_ros.simulation.world.world import World

Progress = Callable[[int, int], None]


def simulate(
    config: SimulationConfig,
    seed: int,
    frames: int,
    out: Path | str,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> None:
    """Simulates a drive and writes it as a bag, whole or not at all.

    Args:
        config: What to simulate.
        seed: Decides the world, the drive and all noise, at least 0; the same seed and configuration give the same
            messages.
        frames: Number of images, at least 1.
        out: A rosbag2 folder, or a file that ends in .mcap.
        overwrite: Replace a bag that is there.
        progress: Called after each image with the number of images done and of all.

    Raises:
        SimulationError: for a seed or a number of frames that is out of range.
        BagError: when the bag cannot be written.
    """
    if not 0 <= seed < 2**63:
        raise SimulationError(f"a seed must be a whole number from 0 to 2^63 - 1, got {seed}")
    if frames < 1:
        raise SimulationError(f"a drive needs at least 1 frame, got {frames}")
    with BagWriter(out, latched=("/tf_static", "/scenario"), overwrite=overwrite) as writer:
        SimulatedDrive(config, seed, frames).record(writer, progress)


class SimulatedDrive:
    """A world with the sensors that are driven through it."""

    def __init__(self, config: SimulationConfig, seed: int, frames: int) -> None:
        """Builds the world of a seed; see `simulate`."""
        self.config, self._seed, self._frames = config, seed, frames
        self.looks = draw_looks(seed, config.looks)
        self.world = World(seed, config.world, LEAD_S + frames / config.camera.rate_hz + 1.0, self.looks)
        self.rig = draw_rig(seed, config.camera, config.radar, config.imaging_radar, config.lidar)
        self._radar = draw_radar(config.radar, generator(seed, Stream.RIG, 1))
        self._imaging_radar = draw_imaging_radar(config.imaging_radar, generator(seed, Stream.RIG, 2))
        self._beams = draw_beams(config.lidar, generator(seed, Stream.RIG, 3))
        lens = generator(seed, Stream.LENS)
        low, high = config.camera.min_jpeg_quality, config.camera.max_jpeg_quality
        self._quality = low + int(lens.random() * (high - low + 0.999))
        light, camera = self.world.light, self.rig.camera
        own = generator(seed, Stream.LOOKS, 1)
        # From the first to the last row a shutter takes 8 to 33 ms.
        self._row_s = own.uniform(0.008, 0.033) / camera.height
        self._bonnet = Bonnet(own, camera.width, camera.height) if self.looks.bonnet else None
        self._camera = CameraUnit(lens, camera.width, camera.height, light.rain, light.random, self.looks)
        style = self.world.style
        self._shader = Shader(generator(seed, Stream.LENS, 1), self.world.atlas, light, style.wetness, self.looks)

    def record(self, writer: BagWriter, progress: Progress | None = None) -> None:
        """Writes all messages in the order of their stamps."""
        events = draw_timetable(self._seed, self.config, self._frames)
        self._write_static_transforms(writer, self.stamp_ns(events[0].time_s))
        self._write_scenario(writer, self.stamp_ns(events[0].time_s))
        record = {
            Sensor.ODOMETRY: self._write_odometry,
            Sensor.RADAR: self._write_radar,
            Sensor.IMAGING_RADAR: self._write_imaging_radar,
            Sensor.LIDAR: self._write_lidar,
            Sensor.CAMERA: self._write_image,
        }
        for event in events:
            record[event.sensor](writer, event)
            if progress is not None and event.sensor is Sensor.CAMERA:
                progress(event.index + 1, self._frames)

    def stamp_ns(self, time_s: float) -> int:
        """The stamp of a time in the drive."""
        return round(self.config.start_s * 1_000_000_000) + round((time_s - LEAD_S) * 1_000_000_000)

    def _at(self, event: Event, frame: str) -> tuple[Scene, EgoMotion, RigidTransform]:
        scene, motion = self.world.scene_at(event.time_s), self.world.ego.motion(event.time_s)
        return scene, motion, motion.world_from_base @ self.rig.footprint_from(frame)

    def _random(self, stream: Stream, event: Event) -> np.random.Generator:
        return generator(self._seed, stream, event.index)

    def _write_static_transforms(self, writer: BagWriter, stamp_ns: int) -> None:
        links = [(rig.FOOTPRINT, rig.BASE, self.rig.footprint_from_base)]
        links += [(rig.BASE, frame, pose) for frame, pose in self.rig.base_from_sensor.items()]
        stamped = [messages.StampedTransform(parent, child, stamp_ns, pose) for parent, child, pose in links]
        writer.write("/tf_static", messages.encode_transforms(factory, stamped), stamp_ns)

    def _write_scenario(self, writer: BagWriter, stamp_ns: int) -> None:
        light, style, camera = self.world.light, self.world.style, self.rig.camera
        scenario = {
            "weather": light.weather.value,
            "time_of_day": light.time_of_day.value,
            "season": style.season.value,
            "street": style.kind.value,
            "random_light": light.random,
            "camera_height_m": round(float(self.rig.footprint_from(rig.CAMERA).translation[2]), 3),
            "focal_length_px": round(camera.fx, 1),
            "seed": self._seed,
        }
        writer.write("/scenario", factory("std_msgs/msg/String", data=json.dumps(scenario)), stamp_ns)

    def _write_odometry(self, writer: BagWriter, event: Event) -> None:
        motion, stamp_ns = self.world.ego.motion(event.time_s), self.stamp_ns(event.time_s)
        into_base = motion.world_from_base.rotation.T
        noise = self._random(Stream.ODOMETRY, event).normal(0, self.config.odometry.speed_noise_mps, 3)
        reading = messages.OdometryReading(
            stamp_ns,
            rig.ODOMETRY,
            rig.FOOTPRINT,
            motion.world_from_base,
            into_base @ motion.velocity + noise * np.array([1.0, 0.0, 0.0]),
            into_base @ motion.rotation_rate,
        )
        writer.write("/odom", messages.encode_odometry(factory, reading), stamp_ns)
        link = messages.StampedTransform(rig.ODOMETRY, rig.FOOTPRINT, stamp_ns, motion.world_from_base)
        writer.write("/tf", messages.encode_transforms(factory, [link]), stamp_ns)

    def _write_radar(self, writer: BagWriter, event: Event) -> None:
        rng = self._random(Stream.RADAR, event)
        scene, pose, velocity = self._swept(event, rig.RADAR, self._radar, rng)
        columns = sweep_radar(scene, pose, velocity, self._radar, rng)
        self._write_points(writer, "/radar/points", columns, event, rig.RADAR)

    def _write_imaging_radar(self, writer: BagWriter, event: Event) -> None:
        rng = self._random(Stream.IMAGING_RADAR, event)
        scene, pose, velocity = self._swept(event, rig.IMAGING_RADAR, self._imaging_radar, rng)
        columns = sweep_imaging_radar(scene, pose, velocity, self._imaging_radar, rng)
        self._write_points(writer, "/radar_4d/points", columns, event, rig.IMAGING_RADAR)

    def _write_points(
        self, writer: BagWriter, topic: str, columns: Mapping[str, npt.NDArray[np.generic]], event: Event, frame: str
    ) -> None:
        stamp_ns = self.stamp_ns(event.time_s)
        writer.write(topic, messages.encode_points(factory, columns, stamp_ns, frame), stamp_ns)

    def _swept(
        self, event: Event, frame: str, unit: RadarUnit, rng: np.random.Generator
    ) -> tuple[Scene, RigidTransform, DoubleArray]:
        """Scene, pose and velocity of a radar where and when it truly measures, not as its stamp and transform say."""
        true = Event(event.time_s + unit.delay_s(rng), event.sensor, event.index)
        scene, motion, pose = self._at(true, frame)
        velocity = motion.velocity_at(self.rig.footprint_from(frame).translation)
        return scene, pose @ unit.mount_from_radar, velocity

    def _write_lidar(self, writer: BagWriter, event: Event) -> None:
        scene, _, pose = self._at(event, rig.LIDAR)
        rng = self._random(Stream.LIDAR, event)
        columns = sweep_lidar(scene, pose, self.config.lidar, self._beams, self.world.style.wetness, rng)
        self._write_points(writer, "/lidar/points", columns, event, rig.LIDAR)

    def _write_image(self, writer: BagWriter, event: Event) -> None:
        scene, motion, pose = self._at(event, rig.CAMERA)
        config, rng = self.config.camera, self._random(Stream.CAMERA, event)
        turn = motion.rotation_rate * self._row_s if self.looks.rolling_shutter else None
        view = render(scene, self.rig.camera, pose, self._shader, config.edge_samples, rng, turn)
        velocity = motion.velocity_at(self.rig.footprint_from(rig.CAMERA).translation)
        moved = motion_field(self.rig.camera, pose, view.depth_m, view.velocity, velocity, motion.rotation_rate, step=4)
        if self._bonnet is not None:
            view, moved = self._bonnet.before(view, self._shader.open_sky), self._bonnet.held(moved)
        image = self._camera.develop(view.radiance, rng, moved)
        stamp_ns, frame = self.stamp_ns(event.time_s), rig.CAMERA
        if config.jpeg:
            compressed = messages.encode_compressed_image(factory, image, stamp_ns, frame, self._quality)
            writer.write("/camera/image_raw/compressed", compressed, stamp_ns)
        else:
            writer.write("/camera/image_raw", messages.encode_image(factory, image, stamp_ns, frame), stamp_ns)
        info = messages.encode_camera_info(factory, self.rig.camera, stamp_ns, frame)
        writer.write("/camera/camera_info", info, stamp_ns)
        if config.depth:
            depth = messages.encode_depth(factory, view.depth_m, stamp_ns, frame)
            writer.write("/ground_truth/depth", depth, stamp_ns)
        if config.classes:
            labels = messages.encode_image(factory, view.label, stamp_ns, frame)
            writer.write("/ground_truth/classes", labels, stamp_ns)
