"""Kernel ridge regression on single frames."""

from tactile_viewgcn.sensors.pipelines import kernel

build = kernel
