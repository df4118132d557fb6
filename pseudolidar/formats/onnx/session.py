"""onnxruntime behind a few functions: where a network runs, and errors a user can act on."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any, Literal

from pseudolidar.errors import MissingDependency, ModelError
from pseudolidar.formats.onnx.model import OnnxModel
from pseudolidar.structures.arrays import AnyArray

Provider = Literal["cpu", "cuda", "tensorrt", "openvino", "coreml", "directml", "auto"]

# Names of onnxruntime, in the order that `auto` prefers, and the package that brings each.
PROVIDERS: dict[str, tuple[str, str]] = {
    "tensorrt": ("TensorrtExecutionProvider", "onnxruntime-gpu"),
    "cuda": ("CUDAExecutionProvider", "onnxruntime-gpu"),
    "coreml": ("CoreMLExecutionProvider", "onnxruntime"),
    "openvino": ("OpenVINOExecutionProvider", "onnxruntime-openvino"),
    "directml": ("DmlExecutionProvider", "onnxruntime-directml"),
    "cpu": ("CPUExecutionProvider", "onnxruntime"),
}
_QUIET = 4  # fatal messages only: errors come as exceptions
_LONGEST_SHOWN = 300


def available_providers() -> tuple[str, ...]:
    """Our names of what the installed onnxruntime was built with, the fastest first."""
    import onnxruntime

    built = onnxruntime.get_available_providers()
    return tuple(name for name, (known, _package) in PROVIDERS.items() if known in built)


class NetworkSession:
    """A network ready to run; callable from several threads at once, without the GIL.

    Args:
        model: the file.
        provider: where it runs.
        threads: of one run.
        flag: of the command line that chose the network.

    Raises:
        ModelError: onnxruntime refuses the file.
        MissingDependency: the provider is not there, or does not start.
    """

    def __init__(
        self,
        model: OnnxModel,
        provider: Provider = "cpu",
        threads: int = 1,
        *,
        flag: str = "--matcher",
    ) -> None:
        import onnxruntime

        self.model = model
        chosen = _chosen(provider, flag)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        options.log_severity_level = _QUIET
        # Threads that wait for work in a loop take the cores from the other frames.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        wanted = [PROVIDERS[chosen][0]] + ([PROVIDERS["cpu"][0]] if chosen != "cpu" else [])
        try:
            self._session: Any = onnxruntime.InferenceSession(
                str(model.path), sess_options=options, providers=wanted
            )
        except _runtime_errors() as error:
            raise _refused(model, error) from error
        active = self._session.get_providers()
        if wanted[0] not in active:  # onnxruntime falls back in silence
            raise MissingDependency(
                f"{wanted[0]} does not start; onnxruntime would run on {active[0]}",
                want="its driver and libraries",
                fix=f"Install them, or pass {flag}.provider cpu.",
            )
        self.provider = chosen
        self._spent = threading.local()
        self.outputs: list[str] = [output.name for output in self._session.get_outputs()]

    def __call__(self, tensors: Mapping[str, AnyArray]) -> list[AnyArray]:
        """The outputs in order.

        Raises:
            ModelError: the network does not take these tensors.
        """
        begun_s = time.perf_counter()
        try:
            found: list[AnyArray] = self._session.run(self.outputs, dict(tensors))
        except _runtime_errors() as error:
            raise _refused(self.model, error, tensors) from error
        self._spent.seconds = self.seconds_here + time.perf_counter() - begun_s
        return found

    @property
    def seconds_here(self) -> float:
        """What all runs of the calling thread took together, s."""
        return float(getattr(self._spent, "seconds", 0.0))


def _chosen(provider: Provider, flag: str) -> str:
    available = available_providers()
    if provider == "auto":
        return available[0]
    if provider not in available:
        name, package = PROVIDERS[provider]
        raise MissingDependency(
            f"the installed onnxruntime has no {name}",
            want=f"one of {', '.join(available)}",
            fix=f"Install {package} instead of onnxruntime, or pass {flag}.provider cpu.",
        )
    return provider


def _runtime_errors() -> tuple[type[Exception], ...]:
    """What onnxruntime raises; its own classes have no base of their own."""
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    own = [getattr(state, name) for name in dir(state)]
    own = [kind for kind in own if isinstance(kind, type) and issubclass(kind, Exception)]
    return (*own, RuntimeError, ValueError, MemoryError)


def _refused(
    model: OnnxModel, error: Exception, tensors: Mapping[str, AnyArray] | None = None
) -> ModelError:
    text = " ".join(str(error).split())
    text = text.partition("RuntimeError: ")[0][:_LONGEST_SHOWN] or type(error).__name__
    given = ""
    if tensors is not None:
        given = "; given " + "; ".join(f"{n} {a.dtype}{list(a.shape)}" for n, a in tensors.items())
    return ModelError(
        f"onnxruntime: {text}{given}", want=f"a network for it: {model.signature}", path=model.path
    )
