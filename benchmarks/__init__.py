"""Measurements of the project against something: integrators, tolerances, other methods."""
