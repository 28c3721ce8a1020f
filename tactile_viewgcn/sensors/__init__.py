"""Building blocks on what the sensors read: unit, maximum, kernels."""
