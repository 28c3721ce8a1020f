"""Networks: modules and formulas on tensors, without files, MLflow or DVC."""
