"""The node's parameters."""

from __future__ import annotations

from radcam_depth_ros.engine import PRECISIONS
from radcam_depth_ros.estimator import OUTPUT_SIZES
from radcam_depth_ros.frame_builder import WITHOUT_RADAR
from radcam_depth_ros.messages import COLORMAPS, DEPTH_ENCODINGS
from radcam_depth_ros.pairing import MAX_SWEEPS
from radcam_depth_ros.parameters.config import IMAGE_TRANSPORTS
from radcam_depth_ros.parameters.spec import ParameterSpec

PARAMETERS: tuple[ParameterSpec, ...] = (
    ParameterSpec(
        "autostart",
        "autostart",
        "Configure and activate at start; false leaves it to a lifecycle manager.",
        read_only=True,
    ),
    ParameterSpec("image_topic", "frame_builder.image", "Topic of the camera's images."),
    ParameterSpec(
        "image_transport",
        "image_transport",
        "raw takes sensor_msgs/Image; compressed takes sensor_msgs/CompressedImage on <image_topic>/compressed, "
        "compressed_topic on image_topic itself.",
        choices=IMAGE_TRANSPORTS,
    ),
    ParameterSpec(
        "camera_info_topic",
        "frame_builder.camera_info",
        "Topic of the camera's calibration; empty takes camera_info beside the images, as image_transport does.",
    ),
    ParameterSpec("radar_topics", "frame_builder.radars", "Topics of the radars' point clouds."),
    ParameterSpec(
        "image_is_rectified",
        "frame_builder.image_is_rectified",
        "The images are free of distortion already, as image_rect topics are.",
    ),
    ParameterSpec("camera_frame", "frame_builder.camera_frame", "Frame of images whose frame_id is empty."),
    ParameterSpec(
        "radar_frame",
        "frame_builder.radar_frame",
        "Frame of radar clouds whose frame_id is empty; one for all radars, or a list with one for each of "
        "radar_topics.",
    ),
    ParameterSpec(
        "radar_fields",
        "frame_builder.radar_fields",
        "Names of the clouds' fields that are not known, as quantity=field with blanks between "
        "(rcs=power radial_speed=v_d); one text for all radars, or a list with one for each of radar_topics.",
    ),
    ParameterSpec(
        "camera_from_radar",
        "frame_builder.camera_from_radar",
        "Extrinsics in place of /tf_static: x y z (m) qx qy qz qw of each radar in the camera's optical frame, 7 "
        "numbers for each of radar_topics; empty reads /tf_static.",
    ),
    ParameterSpec(
        "footprint_frame",
        "frame_builder.footprint_frame",
        "Frame on the road under the vehicle, of which /tf_static gives the camera's height and attitude.",
    ),
    ParameterSpec(
        "camera_height_m",
        "frame_builder.camera_height_m",
        "Height of the camera above the road (m), in place of footprint_frame; 0 where unknown: 1.4 m is then assumed.",
        0.0,
        20.0,
    ),
    ParameterSpec(
        "camera_pitch_deg",
        "frame_builder.camera_pitch_deg",
        "With camera_height_m: how far the camera looks down (degrees).",
        -90.0,
        90.0,
    ),
    ParameterSpec(
        "camera_roll_deg",
        "frame_builder.camera_roll_deg",
        "With camera_height_m: how far the camera leans to its right (degrees).",
        -180.0,
        180.0,
    ),
    ParameterSpec(
        "max_time_offset_s",
        "frame_builder.pairing.max_time_offset_s",
        "An image takes a radar sweep no further away in time than this (s).",
        0.0,
        10.0,
    ),
    ParameterSpec(
        "max_wait_s",
        "frame_builder.pairing.max_wait_s",
        "An image waits for a later radar sweep no longer than this (s).",
        0.0,
        10.0,
    ),
    ParameterSpec(
        "radar_time_offset_s",
        "frame_builder.pairing.radar_time_offset_s",
        "Added to the radars' stamps (s), where their clock differs from the camera's; one number for all radars, or a "
        "list with one for each of radar_topics.",
        -10.0,
        10.0,
    ),
    ParameterSpec(
        "radar_sweeps",
        "frame_builder.pairing.radar_sweeps",
        "An image takes so many sweeps of each radar, the nearest and those before it, moved to the image's time by "
        "the vehicle's motion and the Doppler of what moves.",
        1,
        MAX_SWEEPS,
    ),
    ParameterSpec(
        "max_sweep_age_s",
        "frame_builder.pairing.max_sweep_age_s",
        "With radar_sweeps: those before the nearest are no older than this (s).",
        0.0,
        10.0,
    ),
    ParameterSpec(
        "radar_motion_compensation",
        "frame_builder.radar_motion_compensation",
        "A single sweep is moved to the image's time as well.",
    ),
    ParameterSpec(
        "odometry_topic",
        "frame_builder.odometry",
        "Topic of nav_msgs/Odometry that says how the vehicle moves, where returns are moved; empty takes /tf.",
    ),
    ParameterSpec(
        "odom_frame",
        "frame_builder.odom_frame",
        "Without odometry_topic: the frame that stands still, in which /tf places the vehicle.",
    ),
    ParameterSpec(
        "depth_encoding",
        "output.depth_encoding",
        "Depth images: 32FC1 metres with NaN for no value, or 16UC1 millimetres with 0.",
        choices=DEPTH_ENCODINGS,
    ),
    ParameterSpec(
        "preview_colormap",
        "output.preview_colormap",
        "Colours of the preview; in turbo and jet near is red, in the others light.",
        choices=COLORMAPS,
    ),
    ParameterSpec(
        "preview_near_m",
        "output.preview_near_m",
        "What is nearer has the preview's first colour (m).",
        0.01,
        1000.0,
    ),
    ParameterSpec(
        "preview_far_m",
        "output.preview_far_m",
        "What is further has the preview's last colour (m).",
        0.01,
        1000.0,
    ),
    ParameterSpec(
        "points_stride",
        "output.points_stride",
        "The point cloud has a point for each square of so many pixels' width.",
        1,
        64,
    ),
    ParameterSpec("points_near_m", "output.points_near_m", "What is nearer gives no point (m).", 0.0, 1000.0),
    ParameterSpec("points_far_m", "output.points_far_m", "What is further gives no point (m).", 0.0, 1000.0),
    ParameterSpec(
        "without_radar",
        "frame_builder.without_radar",
        "Images without radar returns: camera_only gives depth of the camera alone; hold gives it of each radar's last "
        "sweep, for max_hold_s; suppress gives none, as long as no return is in view.",
        choices=WITHOUT_RADAR,
    ),
    ParameterSpec(
        "max_hold_s",
        "frame_builder.max_hold_s",
        "With without_radar hold: no sweep is held for longer (s).",
        0.0,
        10.0,
    ),
    ParameterSpec("network", "estimator.network", "Network whose weights come with the package."),
    ParameterSpec(
        "model_file",
        "estimator.model_file",
        "Weight file in place of the network's own: .safetensors with its card, or an exported .pt.",
    ),
    ParameterSpec("device", "estimator.device", "Where the network runs: cpu, cuda, cuda:1 ..."),
    ParameterSpec(
        "precision",
        "estimator.precision",
        "Number format of the network: float32, bfloat16, or auto: what the environment variable "
        "RADCAM_DEPTH_PRECISION says, else what suits the processor.",
        choices=PRECISIONS,
    ),
    ParameterSpec(
        "threads",
        "estimator.threads",
        "CPU threads of the network; 0 takes as many as other work leaves cores.",
        0,
        256,
    ),
    ParameterSpec(
        "output_size",
        "estimator.output_size",
        "native gives depth at the image's size, network at the size that the network works at.",
        choices=OUTPUT_SIZES,
    ),
)
