"""Names of the systems that `model.system` chooses from, by what they read; each is the file of that name in nn/."""

from typing import Literal

OnBackbone = Literal[  # features or feature maps of the pretrained backbone
    "view_gcn",
    "stag",
    "cnn_lstm",
    "conv_lstm",
    "mvcnn",
    "mean",
    "gvcnn",
    "rotationnet",
    "gcn",
    "vote",
]
Member = Literal[
    "trees", "logistic", "knn", "lda", "kernel", "max_logistic", "max_kernel", "max_network"
]  # of an ensemble
OnSensors = Literal[Member, "ensemble"]  # the sensors themselves: nothing is pretrained for them
System = Literal[OnBackbone, OnSensors]
