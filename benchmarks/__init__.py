"""Measurements of the project: against other integrators, tolerances, and other methods."""
