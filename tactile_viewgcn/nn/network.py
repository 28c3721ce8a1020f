"""A network on view sets: the backbone turns frames into features, the head turns view sets of them into logits."""

from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.special import log_softmax
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import INFERENCE_BATCH, Backbone, extract_features
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model

if TYPE_CHECKING:
    from tactile_viewgcn.tables.counts import Counts
    from tactile_viewgcn.views.recording_clusters import RecordingClusters

# numbers in the nodes of a batch of view sets; a larger batch gains no speed
MAX_NODE_VALUES = 1 << 20


class ViewNetwork(nn.Module):
    """Backbone and head for V views.

    Args:
        system: the head's class; model: its options and the backbone's.
        viewpoints: (V, 3); classes: their number; shape: (H, W) of a frame.

    Attributes:
        backbone: frames (n, 1, H, W) to features (n, *feature_shape).
        head: features (B, k, *feature_shape) of view sets to logits, see `ViewSystem`.
        viewpoints: (V, 3); views: V.
        takes_fewer: whether it also answers fewer views than V, cheaply.
        clusters: draws the view sets of whole recordings, if it was trained on clusters; else None.
    """

    transform: str | None = None  # of frames: the table's
    clusters: "RecordingClusters | None" = None
    viewpoints: Tensor

    def __init__(
        self,
        system: type[ViewSystem],
        viewpoints: Tensor,
        classes: int,
        model: Model,
        shape: tuple[int, int],
    ):
        super().__init__()
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)
        maps = system.takes == "maps"
        self.backbone = Backbone(model.backbone, maps=maps)
        self.feature_shape = self.backbone.map_shape(shape) if maps else (self.backbone.features,)
        self.head, self.views = (
            system(viewpoints, self.feature_shape, classes, model),
            len(viewpoints),
        )
        # on maps the head costs more than the backbone
        self.takes_fewer = self.head.takes_fewer and not maps

    def prepare(self, compute: Compute) -> None:
        """Prepare for answers: evaluation mode, on the device of `compute`."""
        self._compute = compute
        # type: ignore[call-overload]  # torch's types lack it
        self.eval().to(compute.device, memory_format=torch.channels_last)

    @torch.inference_mode()
    def frame_values(self, inputs: "Counts") -> Tensor:
        """Features (n, C), or maps (n, C, H, W), on the device, of network input (n, H, W)."""
        starts = range(0, len(inputs), INFERENCE_BATCH)
        parts = (torch.from_numpy(inputs[start : start + INFERENCE_BATCH]) for start in starts)
        with self._compute.autocast():
            return extract_features(self.backbone, map(self._compute.frames, parts))

    @torch.inference_mode()
    def view_sets(self, values: Tensor, sets: np.ndarray) -> np.ndarray:
        """Logits (A, classes) of view sets (A, k) of indices into `frame_values` (n, ...)."""
        return (
            view_set_logits(self.head, values, torch.from_numpy(sets).to(values.device))
            .cpu()
            .numpy()
        )

    def recording(self, values: Tensor, points: "Counts | None" = None) -> np.ndarray:
        """Return the logits (classes,) of a whole recording.

        A system that `takes_more` takes all frames at once. Any other answers view sets like those
        of its training, and the mean of its log-probabilities is taken. If it was trained on
        clusters, the sets are drawn from the recording's own clusters; else they are the
        `recording_sets`, spread over the recording.

        Args:
            values: (T, ...) `frame_values` of the recording's frames in the order of time.
            points: (T, S) network input of these frames at the live sensors, by which they are
                clustered.
        """
        if self.head.takes_more:
            return self.view_sets(values, np.arange(len(values))[None])[0]
        if self.clusters is None:
            sets = recording_sets(len(values), self.views)
        else:
            if points is None:
                raise TypeError(
                    "a network that was trained on clusters needs the points of a recording's frames"
                )
            sets = self.clusters.view_sets(points, self.views)
        return log_softmax(self.view_sets(values, sets), axis=1).mean(axis=0)


def recording_sets(count: int, views: int) -> np.ndarray:
    """The fewest view sets (S, V) of indices that use each of a recording's `count` frames.

    Each is spread over the recording, in the order of time. Where V does not divide the frames,
    some are used twice: of three frames two sets of two views are 0, 1 and 1, 2.
    """
    number = -(-count // views)
    return spread_frames(count, number * views).reshape(views, number).T


def spread_frames(count: int, views: int) -> np.ndarray:
    """Indices int64 (views,) into `count` frames, evenly spread; they repeat where there are fewer than `views`."""
    return ((np.arange(views) + 0.5) * count / views).astype(np.int64)


def view_set_logits(head: ViewSystem, features: Tensor, sets: Tensor) -> Tensor:
    """Logits (A, classes) of view sets (A, k) of indices into features (n, ...), in batches that fit memory.

    Frames are numbered in the order of time.
    """
    batch = max(1, MAX_NODE_VALUES // (sets.shape[1] * features[0].numel()))
    if head.in_time_order:
        sets = sets.sort(dim=1).values
    return torch.cat([head(features[part])[0] for part in sets.split(batch)])
