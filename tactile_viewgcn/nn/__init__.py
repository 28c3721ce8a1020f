"""Building blocks of networks: modules and formulas on tensors, without files, MLflow or DVC."""
