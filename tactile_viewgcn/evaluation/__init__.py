"""Trials on the evaluated set, their statistics, and the results of a run."""
