"""Classifiers of the sensors' readings, without a backbone: unit, estimators, systems."""
