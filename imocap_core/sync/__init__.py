"""Synchronisation of videos by the 3D poses seen in them (section 3.1; Eq. 1, 2)."""

from imocap_core.sync.anchors import Anchor, Hints
from imocap_core.sync.synchronise import SyncResult, synchronise

__all__ = ["Anchor", "Hints", "SyncResult", "synchronise"]
