"""Pretraining of the backbone and fine-tuning of the whole network."""
