"""The lifecycle node: configure loads, activate runs, deactivate stops, cleanup frees.

Between deactivate and activate all parameters may change, the network too: activate then takes up what changed. Limits,
and the way depth is written, change while the node is active as well.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.timer import Timer

from radcam_depth_ros.encoder import Encoder
from radcam_depth_ros.engine import apart, give_back_memory
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame import CameraModel, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder
from radcam_depth_ros.node.answers import Answers
from radcam_depth_ros.node.diagnostics import Diagnostics, Snapshot
from radcam_depth_ros.node.health import Level, Problems
from radcam_depth_ros.node.latency import LatencyTopics
from radcam_depth_ros.node.parameters import Parameters
from radcam_depth_ros.node.session import Session
from radcam_depth_ros.node.topics.factory import build_message, message_class
from radcam_depth_ros.node.topics.inputs import Inputs, find_inputs
from radcam_depth_ros.node.topics.outputs import Outputs
from radcam_depth_ros.node.vitals import Vitals
from radcam_depth_ros.parameters import NODE_NAME, NodeConfig
from radcam_depth_ros.pipeline import Pipeline
from radcam_depth_ros.printable import printable

DIAGNOSTICS_PERIOD_S = 1.0
WARM_UP_SIZE = (800, 448)
"""Width and height of the image that the network is warmed up with."""

CLOSE_S = 10.0
"""So long the end of an inference is waited for when the node is deactivated."""


class RadcamDepthNode(LifecycleNode):
    """Camera and radar messages in, metric depth images out.

    Args:
        make_estimator: Loads the network.
        **options: Of rclpy.node.Node: context, namespace, parameter_overrides and so on.
    """

    def __init__(self, make_estimator: Callable[[EstimatorConfig], Estimator] = Estimator, **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        self._make_estimator = make_estimator
        self._problems = Problems(self._log)
        self._settings = Parameters(self, self._on_parameters, lambda sentence: self._log(Level.WARN, sentence))
        self._phase = "unconfigured"
        self._config: NodeConfig | None = None
        self._inputs: Inputs | None = None
        self._estimator: Estimator | None = None
        self._outputs: Outputs | None = None
        self._latency_topics: LatencyTopics | None = None
        self._session: Session | None = None
        self._vitals: Vitals | None = None
        self._diagnostics = Diagnostics(self, self._problems)
        self._diagnostics_publisher = self.create_publisher(
            message_class("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", 10
        )
        # On the steady clock: diagnostics must come when simulated time stands still, too.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._tick = self.create_timer(DIAGNOSTICS_PERIOD_S, self._on_tick, clock=steady)
        self._start: Timer | None = None
        self._answers = Answers(
            self, lambda sentence: self._problems.report("lifecycle", Level.WARN, sentence), self.report_defect
        )
        if self.get_parameter("autostart").value:
            self._start = self.create_timer(0.0, self._on_start, clock=steady)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Reads the parameters, loads the network and warms it up; on failure the node stays unconfigured."""
        if not self._take_up("the node cannot be configured"):
            self._free()
            return TransitionCallbackReturn.FAILURE
        self._problems.settle_all()
        self._phase = "inactive"
        self._log(Level.OK, f"configured: {self._model()}")
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Takes up parameters that were set since, the network among them; subscribes and publishes.

        On failure the node stays inactive, with the network that it had.
        """
        self._problems.settle_all()
        if not self._take_up("the node cannot be activated"):
            return TransitionCallbackReturn.FAILURE
        inputs, outputs, latency_topics = self._inputs, self._outputs, self._latency_topics
        if inputs is None or outputs is None or latency_topics is None:
            return TransitionCallbackReturn.ERROR
        try:
            self._session = Session(self, self._new_pipeline(), inputs, outputs, latency_topics, self._problems)
        except Exception as error:  # the boundary, as above
            self._problems.report("output", Level.ERROR, f"the node cannot be activated: {_sentence(error)}")
            return TransitionCallbackReturn.FAILURE
        self._vitals = Vitals(self, self._session, outputs, self._problems)
        self._phase = "active"
        self._settings.frozen_because = (
            "the node is active; deactivate it first, then activate it again (ros2 lifecycle set "
            f"{self.get_fully_qualified_name()} deactivate)"
        )
        self._report_transform_messages(inputs)
        self._log(Level.OK, f"active with {self._model()}, reading {', '.join(source.topic for source in inputs)}")
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stops reading and publishing; the network stays loaded, and parameters can be set."""
        self._end_session(CLOSE_S)
        self._settings.frozen_because = ""
        self._phase = "inactive"
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Frees the network."""
        self._free()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stops and frees everything, from any state."""
        self._free()
        self._phase = "finalized"
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After an error in a transition: frees everything, so that the node can be configured again."""
        self._free()
        return super().on_error(state)

    def close(self, timeout_s: float) -> None:
        """Stops everything; a network that is busy for longer than `timeout_s` is left to itself."""
        self._tick.cancel()
        self._end_session(timeout_s)

    def report_defect(self, error: Exception) -> None:
        """Says what came out of a callback that is not this node's own."""
        self._log(Level.ERROR, f"a callback failed: {_sentence(error)}")

    def destroy_node(self) -> None:
        """Ends everything that the node has, its thread included."""
        self.close(CLOSE_S)
        LifecycleNode.destroy_node(self)

    def _take_up(self, failure: str) -> bool:
        """Makes everything as the parameters say; the network is loaded only where they changed.

        Args:
            failure: How the report of what is wrong begins; inputs and network stay as they were then.
        """
        part, estimator, before = "parameters", self._estimator, self._config
        try:
            config = self._settings.read()
            inputs = find_inputs(self, config)
            if self._outputs is None:
                self._outputs = Outputs(self, lambda sentence: self._problems.report("output", Level.WARN, sentence))
            if self._latency_topics is None:
                self._latency_topics = LatencyTopics(self)
            part = "model"
            if estimator is None or not estimator.can_adjust(config.estimator):
                estimator = self._load(config.estimator, before.estimator if before else None)
            estimator.adjust(config.estimator)
            part = "output"
            self._outputs.offer(has_classes=estimator.tells_classes)
        except Exception as error:  # the boundary: whatever it is, the node stays up and says so
            kept = (
                f"; {self._model()} is still loaded, set back what was set to go on with it" if self._estimator else ""
            )
            self._problems.report(part, Level.ERROR, f"{failure}: {_sentence(error)}{kept}")
            return False
        # Only now, so that the network before stays usable when the next one is not; nothing else holds it.
        self._config, self._inputs, self._estimator = _with_full_names(config, inputs), inputs, estimator
        give_back_memory()
        return True

    def _on_parameters(self, names: tuple[str, ...]) -> None:
        """Takes up parameters that were set while the node is active; they were checked before."""
        if self._session is None or self._inputs is None or self._estimator is None:
            return
        try:
            config = _with_full_names(self._settings.read(), self._inputs)
            self._session.pipeline.adjust(config.frame_builder, config.estimator, config.output)
        except Exception as error:  # the boundary: parameters must never take the node down
            self._problems.report("parameters", Level.ERROR, f"parameters are not taken up: {_sentence(error)}")
            return
        self._config = config
        self._log(Level.OK, f"set: {', '.join(f'{name} {self.get_parameter(name).value}' for name in names)}")

    def _load(self, config: EstimatorConfig, before: EstimatorConfig | None) -> Estimator:
        self._log(Level.OK, f"loading {config.model_file or config.network}")
        if before and config.model_file and config.network != before.network:
            self._log(
                Level.WARN,
                f"the parameter network is now {config.network}, but model_file comes first, {config.model_file}; "
                "set model_file to an empty text to use the network's own weights",
            )
        estimator = self._make_estimator(config)
        # Not in this thread, which would keep threads of its own for computing.
        apart(partial(estimator.warm_up, _canonical_camera(estimator)))
        return estimator

    def _new_pipeline(self) -> Pipeline:
        if self._config is None or self._estimator is None:
            raise RadcamDepthError("the node is not configured; configure it first")
        frame_builder, encoder = FrameBuilder(self._config.frame_builder), Encoder(self._config.output, build_message)
        return Pipeline(frame_builder, self._estimator, encoder)

    def _model(self) -> str:
        return self._estimator.describe() if self._estimator else ""

    def _end_session(self, timeout_s: float) -> None:
        session, self._session, self._vitals = self._session, None, None
        if session is not None and not session.close(timeout_s):
            self._log(Level.WARN, f"the network is still busy after {timeout_s:g} s; it is left to itself")

    def _free(self) -> None:
        self._end_session(CLOSE_S)
        if self._outputs is not None:
            self._outputs.destroy()
        if self._latency_topics is not None:
            self._latency_topics.destroy()
        self._outputs = self._latency_topics = self._estimator = self._config = self._inputs = None
        give_back_memory()
        self._settings.frozen_because = ""
        self._phase = "unconfigured"

    def _report_transform_messages(self, inputs: Inputs) -> None:
        config = self._config
        if config is None or inputs.transforms:
            return
        missing = "tf2_msgs is not installed, so"
        if config.frame_builder.needs_transforms:
            self._problems.report(
                "transforms",
                Level.ERROR,
                f"{missing} /tf_static cannot be read and the radar's pose is unknown: install it "
                "(ros-jazzy-tf2-msgs), or set the parameter camera_from_radar (x y z qx qy qz qw)",
            )
        if config.frame_builder.moves_radar and not config.frame_builder.odometry:
            self._problems.report(
                "moving transforms",
                Level.WARN,
                f"{missing} /tf cannot be read and the vehicle's motion is unknown: install it "
                "(ros-jazzy-tf2-msgs), or set the parameter odometry_topic",
            )

    def _on_start(self) -> None:
        if self._start is not None:
            self.destroy_timer(self._start)
            self._start = None
        life: LifecycleNode = self
        # A lifecycle manager may have been quicker.
        if self._phase == "unconfigured":
            life.trigger_configure()
        if self._phase == "inactive":
            life.trigger_activate()

    def _on_tick(self) -> None:
        try:
            computation = self._estimator.computation if self._estimator else None
            snapshot = Snapshot(self._phase, self._model(), self._vitals, computation)
            statuses = self._diagnostics.statuses(snapshot)
            news = self._vitals.watchdog.news() if self._vitals else ""
            if news:
                self._log(Level.WARN, news)
            self._diagnostics_publisher.publish(self._diagnostics.message(statuses, build_message))
        except Exception as error:  # the boundary: what tells of problems must not be one
            self._log(Level.ERROR, f"no diagnostics: {_sentence(error)}")

    def _log(self, level: Level, line: str) -> None:
        logger: RcutilsLogger = LifecycleNode.get_logger(self)
        line = printable(line)
        # rclpy wants one level for each place of a call.
        if level >= Level.ERROR:
            logger.error(line)
        elif level is Level.WARN:
            logger.warning(line)
        else:
            logger.info(line)


def _with_full_names(config: NodeConfig, inputs: Inputs) -> NodeConfig:
    """The config with the topics as they are called in the graph."""
    frame_builder = replace(
        config.frame_builder,
        image=inputs.camera.topic,
        camera_info=inputs.camera_info.topic,
        radars=tuple(radar.topic for radar in inputs.radars),
        odometry=inputs.odometry.topic if inputs.odometry else config.frame_builder.odometry,
    )
    return replace(config, frame_builder=frame_builder)


def _canonical_camera(estimator: Estimator) -> CameraModel:
    width, height = reversed(estimator.only_size) if estimator.only_size else WARM_UP_SIZE
    focal_px = estimator.card.focal_length_px
    return CameraModel(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)


def _sentence(error: Exception) -> str:
    """One line: the error's own when a user can mend it, with its type and place when it is a defect."""
    text = " ".join(str(error).split())
    if isinstance(error, RadcamDepthError):
        return text
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {text} ({place.name} in {place.filename}:{place.lineno})"
