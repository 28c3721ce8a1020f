"""A network on view sets: a backbone turns frames into features, a head joins them to logits."""

import math
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

# most numbers in the nodes of a batch of view sets; a larger batch is no faster
MAX_NODE_VALUES = 1 << 20


class ViewNetwork(nn.Module):
    """Backbone and head for V views.

    Args:
        system: the head's class.
        viewpoints: (V, 3).
        classes: number of classes.
        model: options of the head and of the backbone.
        shape: (H, W) of a frame.

    Attributes:
        backbone: turns frames (n, 1, H, W) into features (n, *feature_shape).
        feature_shape: (C,), or (C, H, W) for a head that takes maps.
        head: turns features (B, k, *feature_shape) of view sets into logits, see `ViewSystem`.
        viewpoints: (V, 3).
        views: V.
        takes_fewer: whether the network also answers fewer views than V, at little cost.
        clusters: draws the view sets of whole recordings, if the network was trained on clusters;
            else None.
        transform: the transform of frames, by its name in a table of frames. None keeps the
            transform of the table.
    """

    transform: str | None = None
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
        self.feature_shape: tuple[int, ...] = (self.backbone.features,)
        if maps:
            self.feature_shape = self.backbone.map_shape(shape)
        self.head = system(viewpoints, self.feature_shape, classes, model)
        self.views = len(viewpoints)
        # on maps the head costs more than the backbone
        self.takes_fewer = self.head.takes_fewer and not maps

    def prepare(self, compute: Compute) -> None:
        """Prepare for answers: evaluation mode, on the device of `compute`."""
        self._compute = compute
        self.eval()
        # torch's types lack the memory format
        self.to(compute.device, memory_format=torch.channels_last)  # type: ignore[call-overload]

    @torch.inference_mode()
    def frame_values(self, inputs: "Counts") -> Tensor:
        """Return the features (n, C), or maps (n, C, H, W), of network input (n, H, W).

        They stay on the device that `prepare` chose.
        """
        starts = range(0, len(inputs), INFERENCE_BATCH)
        parts = (torch.from_numpy(inputs[start : start + INFERENCE_BATCH]) for start in starts)
        with self._compute.autocast():
            return extract_features(self.backbone, map(self._compute.frames, parts))

    @torch.inference_mode()
    def view_sets(self, values: Tensor, sets: np.ndarray) -> np.ndarray:
        """Return the logits (A, classes) of view sets.

        Args:
            values: (n, ...), the result of `frame_values`.
            sets: (A, k) indices of frames.
        """
        index = torch.from_numpy(sets).to(values.device)
        logits: np.ndarray = view_set_logits(self.head, values, index).cpu().numpy()
        return logits

    def recording(self, values: Tensor, points: "Counts | None" = None) -> np.ndarray:
        """Return the logits (classes,) of a whole recording.

        A system that `takes_more` takes all frames at once. Any other system answers view sets like
        the view sets of its training run, and the mean of its log-probabilities is returned. If it
        was trained on clusters, the sets are drawn from the recording's own clusters. Otherwise
        they are the `recording_sets`, which are spread over the recording.

        Args:
            values: (T, ...), `frame_values` of the recording's frames in the order of time.
            points: (T, S) network input of these frames at the live sensors. A network that was
                trained on clusters needs it to cluster the frames.

        Raises:
            TypeError: points are needed and missing.
        """
        if self.head.takes_more:
            every_frame = np.arange(len(values))[None]
            logits: np.ndarray = self.view_sets(values, every_frame)[0]
            return logits
        if self.clusters is None:
            sets = recording_sets(len(values), self.views)
        elif points is None:
            raise TypeError(
                "a network that was trained on clusters needs the points of a recording's frames"
            )
        else:
            sets = self.clusters.view_sets(points, self.views)
        mean: np.ndarray = log_softmax(self.view_sets(values, sets), axis=1).mean(axis=0)
        return mean


def recording_sets(count: int, views: int) -> np.ndarray:
    """Return the fewest view sets (S, V) of indices that use each frame of a recording.

    Each set is spread over the recording, in the order of time. If V does not divide the number of
    frames, some frames are used twice. For example, three frames give two sets of two views: 0, 1
    and 1, 2.

    Args:
        count: number of frames.
        views: V.
    """
    sets = math.ceil(count / views)
    return spread_frames(count, sets * views).reshape(views, sets).T


def spread_frames(count: int, views: int) -> np.ndarray:
    """Return indices int64 (views,) that are evenly spread over frames.

    Args:
        count: number of frames. If there are fewer frames than views, indices repeat.
        views: number of indices.
    """
    return ((np.arange(views) + 0.5) * count / views).astype(np.int64)


def view_set_logits(head: ViewSystem, features: Tensor, sets: Tensor) -> Tensor:
    """Return the logits (A, classes) of view sets, in batches that fit memory.

    Args:
        head: the system that joins the views.
        features: (n, ...) of frames, which are numbered in the order of time.
        sets: (A, k) indices of frames.
    """
    batch = max(1, MAX_NODE_VALUES // (sets.shape[1] * features[0].numel()))
    if head.in_time_order:
        sets = sets.sort(dim=1).values
    parts = torch.split(sets, batch)
    return torch.cat([head(features[part])[0] for part in parts])
