"""Multinomial logistic regression on which sensors a view set presses lightly, firmly and hard."""

from tactile_viewgcn.sensors.pipelines import max_logistic

build = max_logistic
