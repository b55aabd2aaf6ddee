"""Synchronisation of videos by the 3D poses seen in them (section 3.1; Eq. 1, 2)."""

from imocap_core.sync.synchronise import Settings, SyncResult, synchronise

__all__ = ["Settings", "SyncResult", "synchronise"]
