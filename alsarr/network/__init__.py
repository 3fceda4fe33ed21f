"""The network that predicts a metric of every tile before it is shaded."""

from ._attribution import (
    attribute as attribute,
    Attribution as Attribution,
    integrated_gradients as integrated_gradients,
)
from ._choose import choose_mode as choose_mode
from ._evaluate import (
    evaluate as evaluate,
    predictions as predictions,
    Score as Score,
    score_table as score_table,
    with_safety_offset as with_safety_offset,
)
from ._extrapolate import as_error as as_error, extrapolate as extrapolate
from ._fast import infer as infer
from ._file import load_network as load_network, save_network as save_network
from ._loss import adaptive_error as adaptive_error
from ._model import (
    ConvolutionBlock as ConvolutionBlock,
    DEFAULT_CHANNELS as DEFAULT_CHANNELS,
    DEFAULT_OUTPUTS as DEFAULT_OUTPUTS,
    initial_network as initial_network,
    MetricNetwork as MetricNetwork,
)
from ._onnx_export import export_onnx as export_onnx
from ._onnx_import import import_onnx as import_onnx
from ._onnx_run import OnnxNetwork as OnnxNetwork
from ._pooling import pad_to_regions as pad_to_regions, pool_sizes as pool_sizes
from ._samples import load_samples as load_samples, Samples as Samples
from ._shipped import shipped_network as shipped_network
from ._train import train as train, Training as Training
from ._transforms import (
    AbstractTransform as AbstractTransform,
    ClampedTransform as ClampedTransform,
    LogisticTransform as LogisticTransform,
)
