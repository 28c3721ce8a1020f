"""A small residual network on the maximum of each sensor over a view set."""

from tactile_viewgcn.sensors.pipelines import max_network

build = max_network
