"""A salient-object network in an ONNX file: photo in, mask out, on the CPU (extra `masks`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ConfigError
from part2gs_robotics.model.arrays import F32

U8 = NDArray[np.uint8]

SIDE = 320  # pixels where a network takes any size: what U2-Net and its kin are trained on
MEAN, SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet's colours, as trained on
MOST_BYTES = 2 << 30  # the largest such network has 900 MB
ON = 0.5  # probability of the object above which a pixel is its


class Network:
    """A network that was loaded and tried once."""

    def __init__(self, path: Path, session: Any) -> None:
        """Look at what it takes and gives.

        Raises:
            ConfigError: it takes no colour image, or gives no picture.
        """
        self._path, self._session = path, session
        inputs = session.get_inputs()
        shape = list(inputs[0].shape)
        if len(inputs) != 1 or len(shape) != 4 or shape[1] != 3 or "float" not in inputs[0].type:
            raise ConfigError(f"--mask-model {path}: takes {len(inputs)} inputs, the first "
                              f"{inputs[0].type} of {shape}. Expected one of floats, 1 x 3 x "
                              "height x width; export the network so.")
        self._name = str(inputs[0].name)
        self._size = tuple(n if isinstance(n, int) and n > 0 else SIDE for n in shape[:1:-1])
        self._probability(np.zeros((1, 3, self._size[1], self._size[0]), np.float32))

    def mask(self, rgb: U8) -> U8:
        """Return the mask [H, W] of a photo [H, W, 3], 255 = object."""
        small = cv2.resize(rgb, self._size, interpolation=cv2.INTER_AREA)
        scaled = (np.asarray(small, np.float32) / 255.0 - np.array(MEAN, np.float32)) / np.array(
            SPREAD, np.float32)
        found = self._probability(np.ascontiguousarray(scaled.transpose(2, 0, 1)[None]))
        large = cv2.resize(found, (rgb.shape[1], rgb.shape[0]), interpolation=cv2.INTER_LINEAR)
        return np.asarray(np.where(large > ON, 255, 0), np.uint8)

    def _probability(self, image: F32) -> F32:
        """Return the first output [h, w] as a probability."""
        found = np.squeeze(np.asarray(self._session.run(None, {self._name: image})[0]))
        if found.ndim != 2 or not np.isfinite(found).all():
            raise ConfigError(f"--mask-model {self._path}: gives an output of shape {found.shape}, "
                              "or numbers that are none. Expected one picture of the object first; "
                              "export the network so.")
        if found.min() < 0 or found.max() > 1:  # before the sigmoid that some leave to others
            found = 1.0 / (1.0 + np.exp(-np.clip(found, -50, 50)))
        return np.asarray(found, np.float32)


def load_network(path: Path) -> Network:
    """Return the network in a file.

    Raises:
        ConfigError: onnxruntime is not installed, or the file is no such network.
    """
    try:
        import onnxruntime
    except ImportError as err:
        raise ConfigError("--mask-model: onnxruntime is not installed. Expected it to run the "
                          "network; run pip install 'part2gs-robotics[masks]' (or pip install "
                          "onnxruntime).") from err
    if not path.is_file() or path.stat().st_size > MOST_BYTES:
        found = f"{path.stat().st_size} bytes" if path.is_file() else "no file"
        raise ConfigError(f"--mask-model {path}: is {found}. Expected an ONNX file of at most "
                          f"{MOST_BYTES >> 30} GB; check the path.")
    onnxruntime.set_default_logger_severity(4)  # fatal alone: what is wrong comes as an exception
    try:
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        return Network(path, session)
    except ConfigError:
        raise
    except Exception as err:  # its exceptions share no base but this
        reason = " ".join(str(err).split())[:160]
        raise ConfigError(f"--mask-model {path}: cannot be run ({reason}). Expected an ONNX file "
                          "of a salient-object network; export it again.") from err
