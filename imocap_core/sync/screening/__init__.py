"""Screening before the synchronisation: mirrored videos, and videos of another action.

Reading order: registration, explanation, decisions, screening.
"""
