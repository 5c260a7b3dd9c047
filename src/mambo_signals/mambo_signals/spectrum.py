"""Spectrum of a recorded vector signal."""

from __future__ import annotations

import numpy as np

from .resample import Floats, Ints, longest_step, median_period, resampled

SEGMENT = 1024  # samples, at most: 0.2 Hz at 200 Hz
LEAST = 64      # samples of a segment: fewer tell nothing
LONGEST = 1 << 18  # samples that are used, the first ones: 22 min at 200 Hz


def amplitude_density(stamps: Ints, values: Floats) -> tuple[Floats, Floats] | None:
    """
    Return the amplitude spectral density by Welch's method.

    Welch, The use of fast Fourier transform for the estimation of power spectra, 1967: the mean
    over segments that overlap by half, each without its mean and under a Hann window. Segments
    with a gap or a value that is not finite are left out.

    Parameters
    ----------
    stamps : (n,) ns
    values : (n, k)

    Returns
    -------
    frequency (m,) Hz, above 0, and density (m, k) in the unit of the values per root Hz; None if
    no segment of ``LEAST`` samples is whole.

    """
    stamps, first = np.unique(stamps[:LONGEST], return_index=True)
    period = median_period(stamps)
    if len(stamps) < LEAST or stamps[-1] - stamps[0] > 2.0 * LONGEST * period:
        return None
    known = np.where(np.isfinite(values[first]), values[first], np.nan)
    _, even = resampled(stamps, known, round(period), longest_step(stamps))
    size = min(SEGMENT, 1 << (max(len(even) // 4, LEAST).bit_length() - 1))
    if len(even) < size:
        return None
    parts = np.lib.stride_tricks.sliding_window_view(even, size, axis=0)[::size // 2]
    parts = parts[np.isfinite(parts).all(axis=(1, 2))]  # (segments, k, size)
    if not len(parts):
        return None
    window = np.hanning(size + 1)[:-1]
    bins = np.fft.rfft((parts - parts.mean(axis=2, keepdims=True)) * window)
    power = (np.abs(bins) ** 2).mean(axis=0) * 2.0 * period * 1e-9 / (window ** 2).sum()
    return np.fft.rfftfreq(size, period * 1e-9)[1:-1], np.sqrt(power.T[1:-1])
