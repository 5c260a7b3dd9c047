"""Signals over time as plain arrays: resampling, derivatives and outliers. No bags, no topics."""
