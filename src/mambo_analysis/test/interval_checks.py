"""Whether intervals hold what they promise, over seeds."""

import numpy as np
from scipy import stats

LEVEL = 0.95


def assert_covers(truth, values, wide=1.0):
    """
    Check intervals (value, low, high) of one quantity from independent noise.

    As many cover the truth as all but one in a thousand sets of honest intervals would: the lower
    quantile of the binomial distribution. And they are not honest by being wide: half of one is
    1.96 times the spread of the values, within 4 standard errors of a spread, 1/sqrt(2 n), or
    ``wide`` times as much where intervals are known to be cautious.
    """
    values = np.array([(v.value, v.low, v.high) for v in values])
    count = len(values)
    covered = int(np.sum((values[:, 1] <= truth) & (truth <= values[:, 2])))
    assert covered >= stats.binom.ppf(0.001, count, LEVEL), f'{covered} of {count}'
    promised = np.median(values[:, 2] - values[:, 1]) / 2.0 / stats.norm.ppf(0.5 + 0.5 * LEVEL)
    spread = np.std(values[:, 0], ddof=1)
    tolerance = 4.0 / np.sqrt(2.0 * count)
    assert -tolerance < np.log(promised / spread) < tolerance + np.log(wide), promised / spread
