"""Examples whose estimators' answers are known."""

import numpy as np

from tactile_viewgcn.sensors.examples import Points


class Answers:
    """Recordings of three classes, whose points are their numbers.

    An estimator is right about the groups that it was fitted to and wrong about all others, or the other way round.

    Args:
        knows: it is right about the groups that it was fitted to.
        share: of the class that is answered, by member; 0.98 where none is given.
    """

    def __init__(self, labels, groups, *, knows, share=None):
        self.labels, self.classes, self._groups, self.knows, self._share = labels, 3, groups, knows, share or {}

    def of_recordings(self, member):
        return Points(np.arange(len(self.labels)), np.arange(len(self.labels)))

    def fit(self, member, points, seed, used):
        assert set(self.labels[~used]) <= set(self.labels[used])
        return _Estimator(self, np.isin(self._groups, self._groups[used]), self._share.get(member, 0.98))


class _Estimator:
    """An estimator that was fitted to the recordings `used`, bool (R,)."""

    classes = np.arange(3)

    def __init__(self, examples, used, share):
        self._labels, self._wrong, self._share = examples.labels, used != examples.knows, share

    def predict_proba(self, numbers):
        shares = np.full((len(numbers), 3), (1 - self._share) / 2)
        shares[np.arange(len(numbers)), (self._labels + self._wrong)[numbers] % 3] = self._share
        return shares
