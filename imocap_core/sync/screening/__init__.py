"""Screening before the synchronisation: mirrored videos, and videos of another action.

Reading order: pose_evidence, mirror, registration, explanation, decisions, screening.
"""
