"""Nearest neighbours of single frames."""

from tactile_viewgcn.sensors.pipelines import knn

build = knn
