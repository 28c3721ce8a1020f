"""Multinomial logistic regression on single frames."""

from tactile_viewgcn.sensors.pipelines import logistic

build = logistic
