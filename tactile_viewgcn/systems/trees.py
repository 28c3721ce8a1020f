"""Extremely randomised trees on single frames."""

from tactile_viewgcn.sensors.pipelines import trees

build = trees
