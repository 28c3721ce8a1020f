"""Viewpoints, clusters and the view sets drawn from them."""
