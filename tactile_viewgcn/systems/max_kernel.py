"""Kernel ridge regression on the maximum of each sensor over a view set."""

from tactile_viewgcn.sensors.pipelines import max_kernel

build = max_kernel
