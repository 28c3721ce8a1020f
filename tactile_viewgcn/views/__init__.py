"""Viewpoints, clusters, and the view sets that are drawn from them."""
