"""A network made ready to run: number format, frozen TorchScript, CUDA graphs or onnxruntime, warm-up."""

from radcam_depth_ros.engine.engine import MODES, Engine
from radcam_depth_ros.engine.memory import give_back_memory
from radcam_depth_ros.engine.onnx_calls import RUNTIMES
from radcam_depth_ros.engine.precision import PRECISIONS, EngineError, choose
from radcam_depth_ros.engine.processors import Processor, advice
from radcam_depth_ros.engine.threads import apart, offline_threads

__all__ = [
    "MODES",
    "PRECISIONS",
    "RUNTIMES",
    "Engine",
    "EngineError",
    "Processor",
    "advice",
    "apart",
    "choose",
    "give_back_memory",
    "offline_threads",
]
