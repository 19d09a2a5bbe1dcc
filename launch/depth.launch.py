"""The node on a vehicle: ros2 launch radcam_depth_ros depth.launch.py image:=/front/image_raw ..."""

import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

PACKAGE = "radcam_depth_ros"


def is_true(text: str) -> bool:
    """Of an argument that is true or false, in the spelling of YAML or of Python."""
    return text.lower() == "true"


def parts(text: str) -> list[str]:
    """What commas separate; brackets around it and quotes, as parameters have them, may be there."""
    return [part.strip(" '\"") for part in text.strip("[] ").split(",")]


def topics(text: str) -> list[str]:
    """Names separated by commas; [""] stands for an empty list, which a parameter file cannot hold."""
    return [name for name in parts(text) if name] or [""]


def text_or_texts(text: str) -> str | list[str]:
    """One for all radars, or one for each; an empty one keeps its place."""
    texts = parts(text)
    return texts if len(texts) > 1 else texts[0]


def numbers(text: str) -> list[float]:
    """Numbers separated by commas or blanks."""
    return [float(number) for number in text.strip("[] ").replace(",", " ").split()]


def number_or_numbers(text: str) -> float | list[float]:
    """One for all radars, or one for each."""
    (first, *rest) = numbers(text) or [float(text)]
    return [first, *rest] if rest else first


# Arguments that set a parameter. name: (parameter, how the text is read). Empty leaves it to the parameter files.
SETS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "image": ("image_topic", str),
    "image_transport": ("image_transport", str),
    "camera_info": ("camera_info_topic", str),
    "radar_topics": ("radar_topics", topics),
    "image_is_rectified": ("image_is_rectified", is_true),
    "camera_frame": ("camera_frame", str),
    "radar_frame": ("radar_frame", text_or_texts),
    "camera_from_radar": ("camera_from_radar", numbers),
    "footprint_frame": ("footprint_frame", str),
    "camera_height_m": ("camera_height_m", float),
    "radar_time_offset_s": ("radar_time_offset_s", number_or_numbers),
    "depth_encoding": ("depth_encoding", str),
    "output_size": ("output_size", str),
    "points_stride": ("points_stride", int),
    "without_radar": ("without_radar", str),
    "network": ("network", str),
    "model_file": ("model_file", str),
    "device": ("device", str),
    "threads": ("threads", int),
    "autostart": ("autostart", is_true),
}
FORMATS: dict[Callable[[str], Any], str] = {
    topics: ' Separated by commas; "," for none.',
    numbers: " Separated by commas or blanks.",
    text_or_texts: " One for all radars, or one for each, separated by commas.",
    number_or_numbers: " One for all radars, or one for each, separated by commas.",
}
EXPECTED: dict[Callable[[str], Any], str] = {
    int: "a whole number",
    float: "a number",
    numbers: "numbers separated by commas",
    number_or_numbers: "a number, or numbers separated by commas",
}
# Other names of arguments: the parameter's, and those that Autoware's launch files use.
OTHER_NAMES = {
    "image_topic": "image",
    "input/image": "image",
    "camera_info_topic": "camera_info",
    "input/camera_info": "camera_info",
    "input/radar": "radar_topics",
    "param_file": "params_file",
}
# All other arguments. name: (default, description).
OTHERS = {
    "sensors": ("", "Typical sensors: a name of config/sensors, such as ars548_nebula."),
    "params_file": ("", "Parameter file, which wins over sensors; config/node_all.yaml explains every line."),
    "namespace": ("", "Namespace of the node and of its topics: one for each camera."),
    "node_name": ("radcam_depth", "Name of the node."),
    "use_sim_time": ("", "true to go by /clock; empty leaves it to SetParameter or the parameter files."),
    "log_level": ("info", "debug, info, warn, error."),
    "respawn": ("false", "true to start the node again when it ends."),
    "rviz": ("false", "true to look at it in RViz."),
}
EITHER = ("true", "false", "True", "False")
OTHER_CHOICES = {
    "use_sim_time": ("", *EITHER),
    "respawn": EITHER,
    "rviz": EITHER,
    "log_level": ("debug", "info", "warn", "error", "fatal"),
}
# Arguments that `launch` itself reads.
OF_LAUNCH = ("launch-prefix", "launch-prefix-filter", "emulate_tty", "sigterm_timeout", "sigkill_timeout")
NOT_IN_XML = ("namespace", "rviz")  # depth.launch.xml says why
# Parameters, by scripts/generate_pages.py:
HELP = {
    "autostart": "Whether the node configures and activates itself at start.",
    "image_topic": "Topic of the camera's images, relative to the node's namespace; remapping works too.",
    "image_transport": "Type of the images.",
    "camera_info_topic": "Topic of the camera's calibration (sensor_msgs/CameraInfo).",
    "radar_topics": "Topics of the radars: sensor_msgs/PointCloud2 or radar_msgs/RadarScan, by the "
    "type that each topic has.",
    "image_is_rectified": "Whether the images are free of distortion already, as image_rect topics are.",
    "camera_frame": "Frame of the images, in place of their frame_id.",
    "radar_frame": "Frame of the radar clouds, in place of their frame_id, for drivers that leave it "
    "empty or give all radars the same.",
    "camera_from_radar": "Poses of the radars in the camera's optical frame, in place of /tf_static: x y z "
    "in metres and the quaternion qx qy qz qw, 7 numbers for each of radar_topics.",
    "footprint_frame": "Frame on the road under the vehicle (REP 105).",
    "camera_height_m": "Height of the camera above the road in metres, in place of footprint_frame.",
    "radar_time_offset_s": "Correction added to the radars' stamps, in seconds, where their clock or delay "
    "differs from the camera's.",
    "without_radar": "Handling of images without radar returns.",
    "depth_encoding": "Encoding of depth images (REP 118).",
    "points_stride": "Pixel step of depth/points: 1 makes a point of each pixel, 4 of a sixteenth of them.",
    "output_size": "Size of the depth images.",
    "network": "Network whose weights come with the package.",
    "model_file": "Weight file in place of the network's own.",
    "device": "Device that runs the network: cpu, cuda, cuda:1 and so on.",
    "threads": "CPU threads of the network.",
}
CHOICES = {
    "autostart": ("", "true", "false", "True", "False"),
    "image_transport": ("", "raw", "compressed", "compressed_topic"),
    "image_is_rectified": ("", "true", "false", "True", "False"),
    "without_radar": ("", "camera_only", "hold", "suppress"),
    "depth_encoding": ("", "32FC1", "16UC1"),
    "output_size": ("", "native", "network"),
}
# End.
# Topics that an argument replaces, by scripts/generate_pages.py:
OUTPUTS = {
    "output/depth": "depth/image_rect",
    "output/compressed_depth": "depth/image_rect/compressedDepth",
    "output/depth_camera_info": "depth/camera_info",
    "output/semi_dense": "semi_dense/image_rect",
    "output/semi_dense_camera_info": "semi_dense/camera_info",
    "output/confidence": "depth/confidence",
    "output/preview": "depth/preview",
    "output/points": "depth/points",
    "output/semantics": "semantics/image",
    "output/debug/latency_ms": "debug/latency_ms",
    "output/debug/decode_ms": "debug/decode_ms",
    "output/debug/wait_ms": "debug/wait_ms",
    "output/debug/inference_ms": "debug/inference_ms",
    "output/debug/encode_ms": "debug/encode_ms",
}
# End.
# What rviz/radcam_depth.rviz shows; it follows a node into its namespace.
SHOWN = ("depth/preview", "depth/points", "depth/confidence", "semi_dense/image_rect", "radar/points")


def all_names() -> set[str]:
    """Names of all arguments of this file."""
    return {*SETS, *OTHERS, *OTHER_NAMES, *OUTPUTS}


def launched_file(words: Sequence[str]) -> Path | None:
    """The file of this folder that the command line launches; None where another file includes one of them."""
    folder = Path(__file__).resolve().parent
    for before, word in pairwise(("", *words)):
        path = folder / word if before == PACKAGE else Path(word)
        if path.name.endswith((".launch.py", ".launch.xml")) and path.resolve().parent == folder and path.is_file():
            return path.resolve()
    return None


def unknown_names(words: Iterable[str], known: Collection[str]) -> str:
    """Says which of the command line's name:=value no file takes, and what may be meant; empty where all are known."""
    names = [word.partition(":=")[0] for word in words if ":=" in word]
    told = []
    for name in names:
        if name not in known:
            similar = get_close_matches(name, known, n=1)
            told.append(f"{name} (did you mean {similar[0]}?)" if similar else name)
    return ", ".join(told)


def check_names(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Looks for names that are mistyped.

    Those of the command line are an error. An including file may have arguments of its own: those that are like one
    of this file's, which is not given, are only told.

    Raises:
        RuntimeError: with the names that nothing takes.
    """
    file = launched_file(sys.argv)
    if file is None:
        configurations = context.launch_configurations
        open_names = [name for name in all_names() if not configurations.get(name)]
        similar = {name: get_close_matches(name, open_names, n=1, cutoff=0.8) for name in configurations}
        return [
            LogInfo(msg=f"depth.launch.py takes no argument {name}; if it is meant for it: did you mean {match[0]}?")
            for name, match in similar.items()
            if match and name not in all_names()
        ]
    described = AnyLaunchDescriptionSource(str(file)).get_launch_description(context).get_launch_arguments()
    known = {*all_names(), *OF_LAUNCH, *(argument.name for argument in described)}
    if file.suffix == ".xml":
        known -= {*NOT_IN_XML}
    if unknown := unknown_names(context.argv, known):
        raise RuntimeError(f"{file.name} takes no argument {unknown}; ros2 launch --show-args lists what it takes")
    return []


def read(name: str, text: str) -> Any:
    """The parameter's value.

    Raises:
        RuntimeError: for a text that is none, with the argument's name.
    """
    _, convert = SETS[name]
    try:
        return convert(text)
    except ValueError:
        raise RuntimeError(f"the argument {name} must be {EXPECTED[convert]}, got {text!r}") from None


def parameters_of(given: Mapping[str, str]) -> dict[str, Any]:
    """What the arguments set; what they leave empty is the matter of SetParameter and the parameter files."""
    parameters = {parameter: read(name, given[name]) for name, (parameter, _) in SETS.items() if given[name]}
    return parameters | ({"use_sim_time": is_true(given["use_sim_time"])} if given["use_sim_time"] else {})


def with_other_names(given: Mapping[str, str]) -> dict[str, str]:
    """The arguments by their first name: what is empty there is looked for under the others."""
    found = dict(given)
    for other, name in OTHER_NAMES.items():
        found[name] = found[name] or given[other]
    return found


def remappings(given: Mapping[str, str]) -> list[tuple[str, str]]:
    """Of the outputs that are given another name."""
    return [(topic, given[name]) for name, topic in OUTPUTS.items() if given[name] != topic]


def rviz_remappings(given: Mapping[str, str]) -> list[tuple[str, str]]:
    """From the topics that RViz is set to, to the node's."""
    moved = dict(remappings(given))
    namespace = given["namespace"].strip("/")
    base = f"/{namespace}/" if namespace else "/"
    places = [(f"/{topic}", moved.get(topic, topic)) for topic in SHOWN]
    places = [(shown, place if place.startswith("/") else f"{base}{place}") for shown, place in places]
    return [(shown, place) for shown, place in places if shown != place]


def parameter_files(given: Mapping[str, str], share: Path) -> list[str]:
    """The files, of which the last wins.

    Raises:
        RuntimeError: for one that there is not: launch would say that it waits for parameters, and start no node.
    """
    files = [given["params_file"]] if given["params_file"] else []
    if given["sensors"]:
        files.insert(0, str(share / "config" / "sensors" / f"{given['sensors']}.yaml"))
    for file in files:
        if not Path(file).is_file():
            known = ", ".join(sorted(path.stem for path in (share / "config" / "sensors").glob("*.yaml")))
            raise RuntimeError(f"expected a parameter file, got {file}; sensors can be {known}")
    return files


def find_rviz(context: LaunchContext) -> None:
    """Looks for RViz before the node is started.

    Raises:
        RuntimeError: where it is not installed.
    """
    try:
        ExecutableInPackage(package="rviz2", executable="rviz2").perform(context)
    except Exception:  # ament's, or launch's own around it
        raise RuntimeError(
            "rviz:=true needs the package rviz2, which is not installed: sudo apt install ros-jazzy-rviz2, "
            "or leave rviz out; nothing was started"
        ) from None


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Makes the nodes of the arguments' values."""
    told = check_names(context)
    given = with_other_names({name: LaunchConfiguration(name).perform(context).strip() for name in all_names()})
    share = Path(FindPackageShare(PACKAGE).perform(context))
    nodes: list[LaunchDescriptionEntity] = [
        LifecycleNode(
            package=PACKAGE,
            executable="radcam_depth_node",
            name=given["node_name"],
            namespace=given["namespace"],
            parameters=[*parameter_files(given, share), parameters_of(given)],
            remappings=remappings(given),
            arguments=["--ros-args", "--log-level", given["log_level"]],
            respawn=is_true(given["respawn"]),
            respawn_delay=2.0,
            output="both",
        )
    ]
    if is_true(given["rviz"]):
        find_rviz(context)
        clock = {"use_sim_time": is_true(given["use_sim_time"])} if given["use_sim_time"] else {}
        nodes.append(
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(share / "rviz" / "radcam_depth.rviz")],
                parameters=[clock],
                remappings=rviz_remappings(given),
            )
        )
    return [*told, *nodes]


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value="",
            description=HELP[parameter] + FORMATS.get(convert, ""),
            choices=CHOICES.get(parameter),
        )
        for name, (parameter, convert) in SETS.items()
    ]
    arguments += [
        DeclareLaunchArgument(name, default_value=default, description=description, choices=OTHER_CHOICES.get(name))
        for name, (default, description) in OTHERS.items()
    ]
    arguments += [
        DeclareLaunchArgument(other, default_value="", description=f"Another name of {name}.")
        for other, name in OTHER_NAMES.items()
    ]
    arguments += [
        DeclareLaunchArgument(name, default_value=topic, description=f"The topic in place of {topic}.")
        for name, topic in OUTPUTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
