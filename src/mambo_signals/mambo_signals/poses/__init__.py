"""Poses of a motion capture that are no poses of the body."""
