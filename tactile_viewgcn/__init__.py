"""Recognising what a hand holds from several frames of a tactile glove, with a view-graph network."""
