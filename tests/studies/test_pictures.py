"""The pictures of a study."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from studies.pictures import errors_by_cost


@pytest.mark.parametrize(("least", "most"), [(24, 90), (2100, 9990), (40, 560), (0.004, 30), (0.03, 12_000)])
def test_the_labels_of_costs_do_not_touch(least, most):
    costs = np.geomspace(least, most, 5)
    each = {"protocol": "recording", "error": 30.0, "low": 20.0, "high": 40.0, "finetune s": 0.0}
    rows = [each | {"variant": f"v{cost:.0f}", "pretrain s": cost, "ms in batches": cost} for cost in costs]
    figure = errors_by_cost(rows, [], "a study")
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    for axes in figure.axes:
        low, high = axes.get_xlim()
        ticks = [tick for tick in axes.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
        labels = [tick.label1.get_window_extent() for tick in ticks]
        assert len(labels) >= 3 and axes.xaxis.get_minorticklabels() == []
        assert all(one.x1 + 2 < next_one.x0 for one, next_one in pairwise(labels))
