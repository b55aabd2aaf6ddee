"""Feet in contact stay exactly where they stand: places of contact, inverse kinematics of legs."""

from imocap_core.motion.foot_lock.lock import LockedFeet as LockedFeet
from imocap_core.motion.foot_lock.lock import lock_feet as lock_feet
