"""Recordings against motion capture: errors of an estimate, and the bound of any estimator."""
