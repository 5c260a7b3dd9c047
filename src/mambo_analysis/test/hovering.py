"""A flight that hovers, as motion capture sees it."""

from mambo_analysis.capture.captured import Odometry
import numpy as np
from scipy.spatial.transform import Rotation

STEP = 10_000_000  # ns


def hovering(seconds=20.0, position=(0.0, 0.0, 1.0), velocity=(0.0, 0.0, 0.0), rotation=None):
    """Return a flight that stands for 2 s, hovers and stands again for 2 s; z up, no yaw."""
    stamp = np.arange(round(seconds * 100)) * STEP
    t = stamp * 1e-9
    high = np.clip(np.minimum(t - 2.0, seconds - 2.0 - t) / 0.5, 0.0, 1.0)[:, None]
    q = (rotation or Rotation.identity()).as_quat()
    return Odometry(stamp, high * np.array(position), high * np.array(velocity),
                    np.tile(q, (len(t), 1)))
