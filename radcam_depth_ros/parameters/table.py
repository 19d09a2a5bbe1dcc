"""The node's parameters: the ROS name of each with the field of `NodeConfig` that it sets.

Everything else, from the description to the range, stands beside the field.
"""

from __future__ import annotations

from radcam_depth_ros.parameters.spec import ParameterSpec

_PAIRING = "frame_builder.pairing."
SECTIONS = {
    "Start": {"autostart": "autostart"},
    "Inputs": {
        "image_topic": "frame_builder.image",
        "image_transport": "image_transport",
        "camera_info_topic": "frame_builder.camera_info",
        "radar_topics": "frame_builder.radars",
        "radar_fields": "frame_builder.radar_fields",
        "image_is_rectified": "frame_builder.image_is_rectified",
    },
    "Poses of the sensors": {
        "camera_frame": "frame_builder.camera_frame",
        "radar_frame": "frame_builder.radar_frame",
        "camera_from_radar": "frame_builder.camera_from_radar",
        "footprint_frame": "frame_builder.footprint_frame",
        "static_transform_jumps": "frame_builder.static_transform_jumps",
        "camera_height_m": "frame_builder.camera_height_m",
        "camera_pitch_deg": "frame_builder.camera_pitch_deg",
        "camera_roll_deg": "frame_builder.camera_roll_deg",
    },
    "Pairing of images with radar sweeps": {
        **{name: _PAIRING + name for name in ("max_time_offset_s", "max_wait_s")},
        "radar_stamps": "frame_builder.radar_stamps",
        "radar_time_offset_s": _PAIRING + "radar_time_offset_s",
    },
    "Several sweeps": {
        "radar_sweeps": _PAIRING + "radar_sweeps",
        "max_sweep_age_s": _PAIRING + "max_sweep_age_s",
        "radar_motion_compensation": "frame_builder.radar_motion_compensation",
        "odometry_topic": "frame_builder.odometry",
        "odom_frame": "frame_builder.odom_frame",
    },
    "Without radar": {name: f"frame_builder.{name}" for name in ("without_radar", "max_hold_s")},
    "Outputs": {
        "depth_encoding": "output.depth_encoding",
        "min_confidence": "output.min_confidence",
        "sky": "output.sky",
        "preview_colormap": "output.preview_colormap",
        "preview_near_m": "output.preview_near_m",
        "preview_far_m": "output.preview_far_m",
        "points_stride": "output.points_stride",
        "points_near_m": "output.points_near_m",
        "points_far_m": "output.points_far_m",
        "points_min_confidence": "output.points_min_confidence",
        "points_organized": "output.points_organized",
        "points_max_rate_hz": "output.points_max_rate_hz",
        "output_size": "estimator.output_size",
    },
    "Network": {
        name: f"estimator.{name}"
        for name in (
            *("network", "model_file", "allow_exported", "trusted_models"),
            *("device", "precision", "runtime", "threads"),
        )
    },
}
"""ROS name to field path, in the sections of the generated files."""
RENAMED: dict[str, str] = {}
"""Old name to new name of parameters that are still taken under the old one, for one release, with a warning."""
PARAMETERS = tuple(ParameterSpec(name, path) for section in SECTIONS.values() for name, path in section.items())
