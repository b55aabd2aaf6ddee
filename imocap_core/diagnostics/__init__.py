"""The verdict on a run, from its artifacts and without truth.

Reading order: findings, detection_findings, timing, bodies, contradictions, same_take, weak_joints,
action_verdict.
"""
