"""The spectrum equals Welch's method of scipy, and leaves out what is not whole."""

from mambo_signals.spectrum import amplitude_density, LEAST, SEGMENT
import numpy as np
import pytest
from scipy.signal import welch

STEP = 5_000_000  # ns


def test_it_is_the_root_of_welchs_power_density():
    rng = np.random.default_rng(2)
    values = 3.0 + rng.standard_normal((10_000, 2)) * [1.0, 5.0]
    f, density = amplitude_density(np.arange(10_000) * STEP, values)
    wanted_f, power = welch(values, 200.0, nperseg=SEGMENT, axis=0)
    np.testing.assert_allclose(f, wanted_f[1:-1])
    np.testing.assert_allclose(density, np.sqrt(power)[1:-1], rtol=1e-9)


def test_a_tone_stands_at_its_frequency_whatever_is_missing():
    t = np.arange(4000) * 0.005
    values = np.sin(2.0 * np.pi * 30.0 * t)[:, None]
    keep = (t < 9.0) | (t > 10.0)
    values[100] = np.inf
    f, density = amplitude_density(np.arange(4000)[keep] * STEP, values[keep])
    assert f[density[:, 0].argmax()] == pytest.approx(30.0, abs=0.5)
    assert np.isfinite(density).all()


@pytest.mark.parametrize('stamps', [
    np.arange(LEAST - 1) * STEP, np.zeros(500, int), np.array([0]),
    np.append(np.arange(500), [2**62])])
def test_too_little_or_too_far_apart_has_no_spectrum(stamps):
    assert amplitude_density(stamps, np.ones((len(stamps), 1))) is None


def test_without_a_whole_segment_there_is_none():
    values = np.ones((300, 1))
    values[::20] = np.nan
    assert amplitude_density(np.arange(300) * STEP, values) is None
